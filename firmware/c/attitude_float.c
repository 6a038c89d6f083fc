/* attitude_float.c: the attitude in floating point (avr-libc's, 32 bits), as one would write it first.
 *
 * It is here for its cost: Cardan counts the cycles for which PB5 is high, in this image and in
 * attitude.c's. Without taps, and with other last bits than fixed point, it is not meant to pass
 * `cardan compare`. Letters and sets are attitude.c's.
 */
#include <math.h>

#include "cardan_tap.h"
#include "solver.h"

#define FULL_SCALE 32768.0f
#define PI 3.14159265f
#define DOMAIN_LIMIT 1.125f
#define LEAST_EAST 0.01f
#define LEAST_DOWN 0.03f
#define LEAST_VERTICAL 0.1f
#define RESIDUAL_LIMIT 0.15f
#define INCONSISTENCY_LIMIT 0.5f
#define ACCELERATION_LIMIT 0.25f
#define MOST_UNREST 3.0f
#define QUARTER_SECOND_LOG2 9

static float calibration[CALIBRATION_WORDS];
static enum third_tilt third_tilt;

/* What a solution leaves to the next. */
static struct {
    float yaw;
    bool down_negative;
    bool field_z_negative;
    bool signs_lost;
    bool started;
    /* The largest excess of C^2 + S^2 and of the specific force of late, and what is left of each later. */
    float inconsistency;
    float acceleration;
    float fading;
} state;

static uint16_t flags;

/* t3 is gravity along body z where it is measured, its sign where the comparator tells it, else 0. */
struct readings {
    float t1, t2, t3, b1, b2;
};

/* Sines and cosines of the tilt angles of both sets. */
struct tilt {
    float cos_1, cos_2, down;
    float sin_roll, cos_roll;
    float down_square;
    float excess;
};

static void raise(uint16_t flag, bool condition)
{
    if (condition)
        flags |= flag;
}

static float divide(float a, float b)
{
    raise(DOMAIN, b == 0);
    if (b == 0)
        return a < 0 ? -2.0f : 2.0f;
    return a / b;
}

/* sqrt(max(0, rest)). */
static float root(float rest)
{
    return rest < 0 ? 0 : sqrtf(rest);
}

/* a limited to -1..1. */
static float clamp(float a)
{
    return a > 1 ? 1 : a < -1 ? -1 : a;
}

static void check_domain(float a)
{
    raise(DOMAIN, a > DOMAIN_LIMIT || a < -DOMAIN_LIMIT);
}

/* An angle in radians within half a turn. */
static float wrap(float radians)
{
    if (radians > PI)
        return radians - 2 * PI;
    if (radians < -PI)
        return radians + 2 * PI;
    return radians;
}

/* Radians to half turns with 15 fractional bits, modulo a turn. */
static int16_t to_half_turns(float radians)
{
    return (int16_t)(uint16_t)lrintf(radians * (32768.0f / PI));
}

/* Offsets and matrices: averages to g and to parts of the field. */
static struct readings calibrate(const int16_t averages[MOST_CHANNELS], int8_t sign)
{
    const float *offset = calibration;
    const float *tilt = &calibration[TILT_MATRIX];
    const float *field = &calibration[FIELD_MATRIX];
    float x = averages[0] * (1 / FULL_SCALE) - offset[TILT_OFFSET];
    float y = averages[1] * (1 / FULL_SCALE) - offset[TILT_OFFSET + 1];
    struct readings r;

    r.t1 = tilt[0] * x + tilt[1] * y;
    r.t2 = tilt[2] * x + tilt[3] * y;
    x = averages[2] * (1 / FULL_SCALE) - offset[FIELD_OFFSET];
    y = averages[3] * (1 / FULL_SCALE) - offset[FIELD_OFFSET + 1];
    r.b1 = field[0] * x + field[1] * y;
    r.b2 = field[2] * x + field[3] * y;
    r.t3 = sign;
    if (third_tilt == MEASURED)
        r.t3 = (averages[CHANNELS] * (1 / FULL_SCALE) - offset[TILT_Z_OFFSET]) * calibration[TILT_Z_GAIN];
    return r;
}

/* By how much the squared specific force differs from gravity's, without a third axis only upwards. Where
 * there is one the readings become their direction. */
static float take_direction(struct readings *r)
{
    float square = r->t1 * r->t1 + r->t2 * r->t2;
    float inverse;

    if (third_tilt != MEASURED)
        return square > 1 ? square - 1 : 0;
    square += r->t3 * r->t3;
    inverse = divide(1, sqrtf(square));
    r->t1 *= inverse;
    r->t2 *= inverse;
    r->t3 *= inverse;
    return fabsf(square - 1);
}

static struct tilt tilt_of(struct readings *r)
{
    struct tilt tilt = {.excess = take_direction(r)};
    float square_1 = r->t1 * r->t1;
    float square_2 = r->t2 * r->t2;

    tilt.down_square = third_tilt == MEASURED ? r->t3 * r->t3 : 1 - square_1 - square_2;
    tilt.cos_1 = root(1 - square_1);
    tilt.cos_2 = root(1 - square_2);
    tilt.down = root(tilt.down_square);
    tilt.sin_roll = divide(r->t2, tilt.cos_1);
    tilt.cos_roll = divide(tilt.down, tilt.cos_1);
    return tilt;
}

/* The other function of a sine or cosine: sqrt(1 - a^2) with the given sign. */
static float co_function(float a, bool negative)
{
    float magnitude = root(1 - a * a);

    return negative ? -magnitude : magnitude;
}

/* The larger of an excess, up to the most, and what is left of the one before. */
static float larger(float before, float excess)
{
    float faded = before * state.fading;

    if (excess > MOST_UNREST)
        excess = MOST_UNREST;
    return faded < excess ? excess : faded;
}

/* How much motion there was lately, from C^2 + S^2 and from what the specific force is beyond gravity. */
static void track_unrest(float heading_square, float force)
{
    state.inconsistency = larger(state.inconsistency, fabsf(heading_square - 1));
    state.acceleration = larger(state.acceleration, force);
    raise(INCONSISTENT, state.inconsistency > INCONSISTENCY_LIMIT);
    raise(ACCELERATED, state.acceleration > ACCELERATION_LIMIT);
}

static float yaw_of(const struct readings *r, const struct tilt *tilt, bool is_upside_down)
{
    float vertical = calibration[VERTICAL];
    /* The level components of the field: over its horizontal part they are C cos_1 and S cos_2. */
    float level_cos = (r->b1 - vertical * r->t1) * calibration[INVERSE_HORIZONTAL];
    float level_sin = (vertical * r->t2 - r->b2) * calibration[INVERSE_HORIZONTAL];
    float c_1 = divide(level_cos, tilt->cos_1);
    float s_2 = divide(level_sin, tilt->cos_2);
    float tilts = r->t1 * r->t2;
    float twist = r->t1 * tilt->sin_roll;
    float cross_1 = level_sin - twist * c_1;
    float cross_2 = level_cos * tilt->cos_2 - tilts * s_2;
    float yaw_1, yaw_2, cosine, sine_1, heading_square, east_1, east_2, square_1, sum;
    bool is_defined;

    check_domain(c_1);
    check_domain(s_2);
    /* sgn(S) acos(C). */
    yaw_1 = acosf(clamp(c_1));
    if (cross_1 < 0)
        yaw_1 = -yaw_1;
    /* asin(S) in the half that C's sign tells, as set 1's yaw. */
    s_2 = clamp(s_2);
    cosine = co_function(s_2, cross_2 < 0);
    yaw_2 = atan2f(tilt->down * s_2 - tilts * cosine, tilt->down * cosine + tilts * s_2);

    /* Set 1's heading, both functions as quotients, and the weights times C^2 + S^2. */
    sine_1 = divide(cross_1, tilt->cos_roll);
    heading_square = c_1 * c_1 + sine_1 * sine_1;
    east_1 = tilt->cos_1 * sine_1;
    east_2 = tilt->cos_roll * c_1 - twist * sine_1;
    square_1 = east_1 * east_1;
    sum = square_1 + east_2 * east_2;
    is_defined = sum >= LEAST_EAST * heading_square;
    raise(YAW_HELD, !is_defined);
    if (is_defined) {
        state.yaw = wrap(yaw_2 + divide(square_1, sum) * wrap(yaw_1 - yaw_2));
        if (is_upside_down)
            state.yaw = -state.yaw;
    }
    track_unrest(heading_square, tilt->excess);
    return state.yaw;
}

/* The signs of the z components of gravity and field: the one farther from zero keeps its sign, and
 * the sign of their product is seen. */
static void track_signs(float down_square, float field_z_square, bool product_negative)
{
    if (!state.started)
        state.field_z_negative = product_negative;
    else if (down_square < field_z_square)
        state.down_negative = state.field_z_negative != product_negative;
    else
        state.field_z_negative = state.down_negative != product_negative;
    state.started = true;
}

/* Half-space, and whether the readings agree with the Earth's field. Returns whether the device is upside
 * down, as far as that is known. */
static bool check_validity(const struct readings *r, float down_square)
{
    float dip_product = calibration[VERTICAL] - r->b1 * r->t1 - r->b2 * r->t2;
    float field_z_square = 1 - r->b1 * r->b1 - r->b2 * r->b2;
    bool is_steep = down_square < LEAST_DOWN;

    raise(DISTURBED,
          fabsf(dip_product * dip_product - down_square * field_z_square) > RESIDUAL_LIMIT);
    raise(HALF_SPACE, is_steep);
    if (third_tilt == MEASURED)
        return r->t3 < 0;
    track_signs(down_square, field_z_square, dip_product < 0);
    if (down_square + field_z_square < LEAST_VERTICAL)
        state.signs_lost = true;
    if (third_tilt == ABSENT) {
        raise(HALF_SPACE, state.signs_lost);
    } else if (!is_steep) {
        state.down_negative = r->t3 < 0;
        state.field_z_negative = state.down_negative != (dip_product < 0);
    }
    return state.down_negative;
}

void solve(const int16_t averages[MOST_CHANNELS], int8_t sign, struct solution *solution)
{
    struct readings readings;
    struct tilt tilt;
    float roll;
    bool is_upside_down;

    flags = 0;
    readings = calibrate(averages, sign);
    tilt = tilt_of(&readings);
    is_upside_down = check_validity(&readings, tilt.down_square);
    solution->pitch = to_half_turns(-asinf(clamp(readings.t1)));
    roll = asinf(clamp(tilt.sin_roll));
    solution->roll = to_half_turns(is_upside_down ? PI - roll : roll);
    solution->yaw = to_half_turns(yaw_of(&readings, &tilt, is_upside_down));
    solution->flags = flags;
}

void solver_set_upright(void)
{
    state.down_negative = false;
    state.field_z_negative = false;
    state.signs_lost = false;
    state.started = false;
}

void solver_start(const int32_t words[CALIBRATION_WORDS], uint8_t period_log2, enum third_tilt fitted)
{
    uint8_t shift = period_log2 < QUARTER_SECOND_LOG2 ? QUARTER_SECOND_LOG2 - period_log2 : 0;
    uint8_t i;

    third_tilt = fitted;
    state.fading = 1 - ldexpf(1, -shift);
    for (i = 0; i < CALIBRATION_WORDS; i++)
        calibration[i] = ldexpf(words[i], -CALIBRATION_FRAC);
}
