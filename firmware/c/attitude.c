/* attitude.c: the attitude in fixed point, bit for bit what Cardan's native firmware computes.
 *
 * Written from the equations and from firmware/wordlengths.toml, as a team that brings its own C would.
 * Letters: t1, t2 gravity along body x, y in g; b1, b2 field along body x, y over the total field;
 * C, S cosine and sine of a heading. Set 1 is yaw, pitch, roll (Z-Y-X), set 2 the order Z-X-Y; both give
 * a yaw, and yaw is their weighted mean. Angles are in half turns.
 *
 * A function with a node as its first argument computes that node's value and publishes it.
 */
#include "cardan_tap.h"
#include "fixed.h"
#include "solver.h"

/* The shifts below are those of the formats with this hash. After a change of formats (and
 * `cargo xtask c-header`) adapt them, then copy the new hash from nodes.h. */
#if CARDAN_FORMATS_HASH != 0x3a5c9c799743c974
#error "attitude.c is written for other formats than nodes.h has: adapt its shifts, then this hash"
#endif

CARDAN_TABLES;

/* Fractional bits: of most words, of words whose values stay under 1, and of exact products. */
#define FRAC 14
#define FRAC_UNIT 15
#define FRAC_SQUARE 28

#define ONE FIXED(1.0, FRAC)
#define ONE_SQUARE ((int32_t)1 << FRAC_SQUARE)
/* asin(x) / (pi x) = sum of c_k x^(2k) for |x| <= 1/sqrt(2), minimax in the angle. */
#define ASIN_FRAC 16
#define ASIN_0 FIXED(0.3182367229451062, ASIN_FRAC)
#define ASIN_1 FIXED(0.054809690876860634, ASIN_FRAC)
#define ASIN_2 FIXED(0.012803647549659774, ASIN_FRAC)
#define ASIN_3 FIXED(0.03761888323740325, ASIN_FRAC)
#define QUARTER_TURN FIXED(0.5, FRAC_UNIT)
#define HALF_TURN FIXED(-1.0, FRAC_UNIT) /* 1 and -1 are the same angle */
/* Limits of the status bits. */
#define DOMAIN_LIMIT FIXED(1.125, FRAC)
#define LEAST_EAST FIXED(0.01, FRAC_UNIT)
#define LEAST_DOWN FIXED(0.03, FRAC)
#define LEAST_VERTICAL FIXED(0.1, FRAC)
#define RESIDUAL_LIMIT FIXED(0.15, FRAC)

static struct {
    int16_t tilt_offset[2];
    int16_t tilt_gain[2][2];
    int16_t field_offset[2];
    int16_t field_gain[2][2];
    int16_t vertical;
    int16_t inverse_horizontal;
} calibration;

/* What a solution leaves to the next. */
static struct {
    int16_t yaw;
    bool down_negative;
    bool field_z_negative;
    bool signs_lost;
    bool started;
} state;

static uint16_t flags;

struct readings {
    int16_t t1, t2, b1, b2;
};

/* Sines and cosines of the tilt angles of both sets. */
struct tilt {
    int16_t cos_1, cos_2, down;
    int16_t sin_roll, cos_roll;
    int16_t down_square;
};

static inline int16_t publish(enum cardan_node node, int16_t word)
{
    cardan_tap(node, word);
    return word;
}

static inline int32_t publish_wide(enum cardan_node node, int32_t word)
{
    cardan_tap(node, word);
    return word;
}

static void raise(uint16_t flag, bool condition)
{
    if (condition)
        flags |= flag;
}

/* a b in words of FRAC bits. */
static int16_t multiply(enum cardan_node node, int16_t a, int16_t b)
{
    return publish(node, multiply_round(a, b, FRAC));
}

/* a b where one factor or the product has a bit more. */
static int16_t multiply_unit(enum cardan_node node, int16_t a, int16_t b)
{
    return publish(node, multiply_round(a, b, FRAC_UNIT));
}

static int32_t multiply_exact(enum cardan_node node, int16_t a, int16_t b)
{
    return publish_wide(node, product(a, b));
}

static int16_t add(enum cardan_node node, int16_t a, int16_t b)
{
    return publish(node, add_limited(a, b));
}

static int16_t subtract(enum cardan_node node, int16_t a, int16_t b)
{
    return publish(node, subtract_limited(a, b));
}

/* a 2^places / b; the end of the word and a status bit if b is 0. */
static int16_t divide(enum cardan_node node, int16_t a, int16_t b, uint8_t places)
{
    raise(DOMAIN, b == 0);
    if (b == 0)
        return publish(node, a < 0 ? INT16_MIN : INT16_MAX);
    return publish(node, divide_round(a, b, places));
}

/* sqrt(max(0, rest)). */
static int16_t root(enum cardan_node node, int32_t rest)
{
    int32_t radicand = publish_wide(NODE_RADICAND, rest < 0 ? 0 : rest);

    return publish(node, square_root((uint32_t)radicand));
}

static void check_domain(int16_t a)
{
    raise(DOMAIN, a > DOMAIN_LIMIT || a < -DOMAIN_LIMIT);
}

/* The angle of a unit vector, given the smaller of its magnitudes: the inverse sine by a polynomial, the
 * rest by symmetry. */
static int16_t assemble(int16_t x, bool sine_smaller, bool sine_negative, bool cosine_negative)
{
    int16_t square = multiply_unit(NODE_ASIN_SQUARE, x, x);
    int16_t term = multiply_unit(NODE_ASIN_TERM, ASIN_3, square);
    int16_t sum = add(NODE_ASIN_SUM, term, ASIN_2);
    int16_t octant, complement, quadrant, behind, upper, lower;

    term = multiply_unit(NODE_ASIN_TERM, sum, square);
    sum = add(NODE_ASIN_SUM, term, ASIN_1);
    term = multiply_unit(NODE_ASIN_TERM, sum, square);
    sum = add(NODE_ASIN_SUM, term, ASIN_0);
    octant = publish(NODE_OCTANT, multiply_round(sum, x, ASIN_FRAC));
    complement = subtract(NODE_OCTANT, QUARTER_TURN, octant);
    quadrant = publish(NODE_QUADRANT, sine_smaller ? octant : complement);
    behind = publish(NODE_ANGLE, subtract_wrapped(HALF_TURN, quadrant));
    upper = publish(NODE_ANGLE, cosine_negative ? behind : quadrant);
    lower = publish(NODE_ANGLE, subtract_wrapped(0, upper));
    return publish(NODE_ANGLE, sine_negative ? lower : upper);
}

/* atan2(sine, cosine) for a vector of the given length; without one, for a unit vector. */
static int16_t angle(int16_t sine, int16_t cosine, const int16_t *length)
{
    int16_t s = publish(NODE_MAGNITUDE, magnitude_limited(sine));
    int16_t c = publish(NODE_MAGNITUDE, magnitude_limited(cosine));
    int16_t smaller = publish(NODE_MAGNITUDE, s < c ? s : c);
    int16_t x = length ? divide(NODE_ASIN_ARGUMENT, smaller, *length, FRAC_UNIT)
                       : add(NODE_ASIN_ARGUMENT, smaller, smaller);

    return assemble(x, s < c, sine < 0, cosine < 0);
}

/* gain (x, y), a row of a matrix by a vector. */
static int16_t row(enum cardan_node node, enum cardan_node part, const int16_t gain[2], int16_t x,
                   int16_t y, uint8_t places)
{
    int32_t a = multiply_exact(part, gain[0], x);
    int32_t b = multiply_exact(part, gain[1], y);

    return publish(node, round_shift(a + b, places));
}

/* Offsets and matrices: averages over full scale to g and to parts of the field. */
static struct readings calibrate(const int16_t averages[CHANNELS])
{
    struct readings r;
    int16_t a[CHANNELS];
    uint8_t channel;

    for (channel = 0; channel < CHANNELS; channel++) {
        int16_t offset = channel < 2 ? calibration.tilt_offset[channel]
                                     : calibration.field_offset[channel - 2];
        a[channel] = subtract(NODE_CENTRED, averages[channel], offset);
    }
    r.t1 = row(NODE_TILT_X, NODE_TILT_PRODUCT, calibration.tilt_gain[0], a[0], a[1], 15);
    r.t2 = row(NODE_TILT_Y, NODE_TILT_PRODUCT, calibration.tilt_gain[1], a[0], a[1], 15);
    r.b1 = row(NODE_FIELD_X, NODE_FIELD_PRODUCT, calibration.field_gain[0], a[2], a[3], 14);
    r.b2 = row(NODE_FIELD_Y, NODE_FIELD_PRODUCT, calibration.field_gain[1], a[2], a[3], 14);
    return r;
}

static int32_t less_square(int32_t from, int32_t square)
{
    return publish_wide(NODE_REST, limit31(from - square));
}

static struct tilt tilt_of(const struct readings *r)
{
    struct tilt tilt;
    int32_t square_1 = multiply_exact(NODE_SQUARE, r->t1, r->t1);
    int32_t square_2 = multiply_exact(NODE_SQUARE, r->t2, r->t2);
    int32_t rest_1 = less_square(ONE_SQUARE, square_1);
    int32_t rest_2 = less_square(ONE_SQUARE, square_2);
    int32_t rest = less_square(rest_1, square_2);

    tilt.cos_1 = root(NODE_COS_1, rest_1);
    tilt.cos_2 = root(NODE_COS_2, rest_2);
    tilt.down = root(NODE_DOWN, rest);
    tilt.sin_roll = divide(NODE_SIN_ROLL, r->t2, tilt.cos_1, FRAC);
    tilt.cos_roll = divide(NODE_COS_ROLL, tilt.down, tilt.cos_1, FRAC);
    check_domain(r->t1);
    check_domain(tilt.sin_roll);
    tilt.down_square = publish(NODE_DOWN_SQUARE, round_shift(rest, FRAC_SQUARE - FRAC));
    return tilt;
}

/* a limited to -1..1. */
static int16_t clamp(int16_t a)
{
    a = publish(NODE_UNIT_ARGUMENT, a > ONE ? ONE : a);
    return publish(NODE_UNIT_ARGUMENT, a < -ONE ? -ONE : a);
}

/* The other function of a clamped sine or cosine: sqrt(1 - a^2) with the given sign. */
static int16_t co_function(enum cardan_node node, int16_t a, bool negative)
{
    int32_t square = multiply_exact(NODE_SQUARE, a, a);
    int16_t magnitude = root(NODE_HEADING_MAGNITUDE, less_square(ONE_SQUARE, square));
    int16_t opposite = publish(NODE_HEADING_MAGNITUDE, negate_limited(magnitude));

    return publish(node, negative ? opposite : magnitude);
}

/* sgn(S) acos(C). */
static int16_t yaw_of_set_1(int16_t cosine, bool sine_negative)
{
    int16_t sine;

    cosine = clamp(cosine);
    sine = co_function(NODE_HEADING_SIN_1, cosine, sine_negative);
    return publish(NODE_YAW_1, angle(sine, cosine, 0));
}

/* asin(S) in the half that C's sign tells, as set 1's yaw: by the matrix elements M00, M01 times cos_2. */
static int16_t yaw_of_set_2(int16_t sine, bool cosine_negative, int16_t tilts, const struct tilt *tilt)
{
    int16_t cosine, a, b, north, east, length;

    sine = clamp(sine);
    cosine = co_function(NODE_HEADING_COS_2, sine, cosine_negative);
    a = multiply(NODE_MATRIX_TERM, tilt->down, cosine);
    b = multiply(NODE_MATRIX_TERM, tilts, sine);
    north = add(NODE_NORTH_X, a, b);
    a = multiply(NODE_MATRIX_TERM, tilt->down, sine);
    b = multiply(NODE_MATRIX_TERM, tilts, cosine);
    east = subtract(NODE_EAST_X, a, b);
    length = multiply(NODE_MATRIX_LENGTH, tilt->cos_1, tilt->cos_2);
    return publish(NODE_YAW_2, angle(east, north, &length));
}

/* Set 1's weight e1^2 / (e1^2 + e2^2), both taken times cos_roll^2 (S^2 + C^2), which spares divisions.
 * Returns whether yaw is defined. */
static bool weigh(const struct tilt *tilt, int16_t twist, int16_t c, int16_t cross, int16_t *weight)
{
    int16_t roll_square = multiply(NODE_ROLL_SQUARE, tilt->cos_roll, tilt->cos_roll);
    int16_t east_1 = multiply(NODE_WEIGHT_X, tilt->cos_1, cross);
    int16_t a = multiply(NODE_WEIGHT_PART, roll_square, c);
    int16_t b = multiply(NODE_WEIGHT_PART, twist, cross);
    int16_t east_2 = subtract(NODE_WEIGHT_Y, a, b);
    int16_t square_1 = multiply(NODE_WEIGHT_SQUARE, east_1, east_1);
    int16_t square_2 = multiply(NODE_WEIGHT_SQUARE, east_2, east_2);
    int16_t sum = add(NODE_WEIGHT_SUM, square_1, square_2);
    int16_t sine = multiply(NODE_SCALE_PART, cross, cross);
    int16_t cosine = multiply(NODE_SCALE_PART, a, c);
    int16_t scale = add(NODE_SCALE, sine, cosine);

    *weight = divide(NODE_WEIGHT_1, square_1, sum, FRAC_UNIT);
    return sum >= multiply_unit(NODE_LEAST_SUM, LEAST_EAST, scale);
}

static int16_t yaw_of(const struct readings *r, const struct tilt *tilt, bool is_upside_down)
{
    int32_t dip_x = multiply_exact(NODE_DIP_PART, calibration.vertical, r->t1);
    int32_t dip_y = multiply_exact(NODE_DIP_PART, calibration.vertical, r->t2);
    /* The level components of the field: over its horizontal part they are C cos_1 and S cos_2. */
    int32_t b1 = (int32_t)r->b1 << FRAC_UNIT;
    int32_t b2 = (int32_t)r->b2 << FRAC_UNIT;
    int16_t level_x = publish(NODE_LEVEL_X, round_shift(b1 - dip_x, 14));
    int16_t level_y = publish(NODE_LEVEL_Y, round_shift(dip_y - b2, 14));
    int16_t level_cos = multiply(NODE_LEVEL_COS, level_x, calibration.inverse_horizontal);
    int16_t level_sin = multiply(NODE_LEVEL_SIN, level_y, calibration.inverse_horizontal);
    int16_t c_1 = divide(NODE_HEADING_COS_1, level_cos, tilt->cos_1, FRAC);
    int16_t s_2 = divide(NODE_HEADING_SIN_2, level_sin, tilt->cos_2, FRAC);
    int16_t twist, part, cross_1, tilts, scaled, cross_2;
    int16_t yaw_1, yaw_2, weight, difference, correction, fresh, opposite;
    bool defined;

    check_domain(c_1);
    check_domain(s_2);
    /* The other function of each heading, times cosines that are never negative: its sign counts. */
    twist = multiply(NODE_TWIST_1, r->t1, tilt->sin_roll);
    part = multiply(NODE_TWIST_PART, twist, c_1);
    cross_1 = subtract(NODE_CROSS_1, level_sin, part);
    tilts = multiply(NODE_TILT_CROSS, r->t1, r->t2);
    scaled = multiply(NODE_TWIST_PART, level_cos, tilt->cos_2);
    part = multiply(NODE_TWIST_PART, tilts, s_2);
    cross_2 = subtract(NODE_CROSS_2, scaled, part);

    yaw_1 = yaw_of_set_1(c_1, cross_1 < 0);
    yaw_2 = yaw_of_set_2(s_2, cross_2 < 0, tilts, tilt);

    defined = weigh(tilt, twist, c_1, cross_1, &weight);
    difference = publish(NODE_YAW_DIFFERENCE, subtract_wrapped(yaw_1, yaw_2));
    correction = multiply_unit(NODE_YAW_CORRECTION, weight, difference);
    fresh = publish(NODE_YAW_FRESH, add_wrapped(yaw_2, correction));
    opposite = publish(NODE_YAW_FRESH, subtract_wrapped(0, fresh));
    fresh = publish(NODE_YAW_FRESH, is_upside_down ? opposite : fresh);
    raise(YAW_HELD, !defined);
    state.yaw = publish(NODE_YAW, defined ? fresh : state.yaw);
    return state.yaw;
}

/* The signs of the z components of gravity and field: the one farther from zero keeps its sign, and
 * the sign of their product is seen. */
static void track_signs(int16_t down_square, int16_t field_z_square, bool product_negative)
{
    if (!state.started)
        state.field_z_negative = product_negative;
    else if (down_square < field_z_square)
        state.down_negative = state.field_z_negative != product_negative;
    else
        state.field_z_negative = state.down_negative != product_negative;
    state.started = true;
}

/* The half-space, from what the readings and a third tilt axis tell of the z components. Returns whether
 * the device is upside down, as far as a third axis makes that certain. */
static bool find_half_space(int16_t down_square, int16_t field_z_square, bool product_negative,
                            int8_t tilt_z)
{
    /* The sum has a fractional bit less, so that it fits. */
    int16_t z_sum = publish(NODE_VERTICAL_SUM, round_shift((int32_t)down_square + field_z_square, 1));
    bool is_steep = down_square < LEAST_DOWN;

    track_signs(down_square, field_z_square, product_negative);
    if ((int32_t)z_sum * 2 < LEAST_VERTICAL)
        state.signs_lost = true;
    if (tilt_z != 0 && !is_steep) {
        state.down_negative = tilt_z < 0;
        state.field_z_negative = state.down_negative != product_negative;
        state.signs_lost = false;
    }
    raise(HALF_SPACE, is_steep || (tilt_z == 0 && (state.down_negative || state.signs_lost)));
    return tilt_z != 0 && state.down_negative;
}

/* Whether the readings agree with the Earth's field, and the half-space. */
static bool check_validity(const struct readings *r, int16_t down_square, int8_t tilt_z)
{
    const uint8_t places = FRAC_SQUARE - FRAC;
    int32_t vertical = (int32_t)calibration.vertical << (FRAC_SQUARE - FRAC_UNIT);
    int32_t part = multiply_exact(NODE_READINGS_PART, r->b1, r->t1);
    int32_t sum = publish_wide(NODE_READINGS_SUM, limit31(vertical - part));
    int16_t dip_product, field_z_square, seen, expected, residual;

    part = multiply_exact(NODE_READINGS_PART, r->b2, r->t2);
    dip_product = publish(NODE_DIP_PRODUCT, round_shift(sum - part, places));
    part = multiply_exact(NODE_READINGS_PART, r->b1, r->b1);
    sum = publish_wide(NODE_READINGS_SUM, limit31(ONE_SQUARE - part));
    part = multiply_exact(NODE_READINGS_PART, r->b2, r->b2);
    field_z_square = publish(NODE_FIELD_Z_SQUARE, round_shift(sum - part, places));

    seen = multiply(NODE_RESIDUAL_PART, dip_product, dip_product);
    expected = multiply(NODE_RESIDUAL_PART, down_square, field_z_square);
    residual = subtract(NODE_RESIDUAL, seen, expected);
    residual = publish(NODE_RESIDUAL, magnitude_limited(residual));
    raise(DISTURBED, residual > RESIDUAL_LIMIT);
    return find_half_space(down_square, field_z_square, dip_product < 0, tilt_z);
}

void solve(const int16_t averages[CHANNELS], int8_t tilt_z, struct solution *solution)
{
    struct readings readings;
    struct tilt tilt;
    int16_t roll, behind;
    bool is_upside_down;

    flags = 0;
    cardan_tap(NODE_TILT_Z, tilt_z * (1 << FRAC));
    readings = calibrate(averages);
    tilt = tilt_of(&readings);
    is_upside_down = check_validity(&readings, tilt.down_square, tilt_z);
    solution->pitch =
        publish(NODE_PITCH, subtract_wrapped(0, angle(readings.t1, tilt.cos_1, 0)));
    roll = angle(tilt.sin_roll, tilt.cos_roll, 0);
    behind = publish(NODE_ANGLE, subtract_wrapped(HALF_TURN, roll));
    solution->roll = publish(NODE_ROLL, is_upside_down ? behind : roll);
    solution->yaw = yaw_of(&readings, &tilt, is_upside_down);
    solution->flags = flags;
}

void solver_set_upright(void)
{
    state.down_negative = false;
    state.field_z_negative = false;
    state.signs_lost = false;
    state.started = false;
}

static int16_t setting(const int32_t *word, uint8_t frac)
{
    return round_shift(*word, CALIBRATION_FRAC - frac);
}

void solver_start(const int32_t words[CALIBRATION_WORDS])
{
    uint8_t i, j;

    for (i = 0; i < 2; i++) {
        calibration.tilt_offset[i] = setting(&words[TILT_OFFSET + i], 15);
        calibration.field_offset[i] = setting(&words[FIELD_OFFSET + i], 15);
        for (j = 0; j < 2; j++) {
            calibration.tilt_gain[i][j] = setting(&words[TILT_MATRIX + 2 * i + j], 14);
            calibration.field_gain[i][j] = setting(&words[FIELD_MATRIX + 2 * i + j], 13);
        }
    }
    calibration.vertical = setting(&words[VERTICAL], 15);
    calibration.inverse_horizontal = setting(&words[INVERSE_HORIZONTAL], 13);
}
