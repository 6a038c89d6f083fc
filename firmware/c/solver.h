/* solver.h: what device.c asks of a solver; attitude.c and attitude_float.c are two. */
#ifndef SOLVER_H
#define SOLVER_H

#include <stdbool.h>
#include <stdint.h>

/* Sensor channels in conversion order: tilt x, tilt y, field x, field y. */
#define CHANNELS 4
/* And tilt z, where it is measured. */
#define MOST_CHANNELS 5
/* Calibration words, with CALIBRATION_FRAC fractional bits. */
#define CALIBRATION_WORDS 17
#define CALIBRATION_FRAC 28

/* Order of the calibration words; the matrices are row by row. */
enum {
    TILT_OFFSET = 0,
    TILT_MATRIX = 2,
    FIELD_OFFSET = 6,
    FIELD_MATRIX = 8,
    HORIZONTAL = 12,
    VERTICAL = 13,
    INVERSE_HORIZONTAL = 14,
    TILT_Z_OFFSET = 15,
    TILT_Z_GAIN = 16
};

/* The third tilt axis, as in the settings. */
enum third_tilt { ABSENT = 0, COMPARATOR = 1, MEASURED = 2 };

/* Status bits of a frame. */
enum {
    SATURATION = 1 << 0,   /* a code stood at either end of the scale */
    HALF_SPACE = 1 << 1,   /* the sign of gravity along body z is not known */
    DISTURBED = 1 << 2,    /* the readings contradict the Earth's field */
    UNCALIBRATED = 1 << 3, /* no calibration in EEPROM: nominal values */
    DOMAIN = 1 << 4,       /* an inverse function's argument beyond 1 by more than noise, or x / 0 */
    LATE = 1 << 5,         /* a conversion or a solution came late */
    YAW_HELD = 1 << 6,     /* yaw is undefined here; the last one is repeated */
    INCONSISTENT = 1 << 7, /* the readings contradict each other, or did a moment ago */
    ACCELERATED = 1 << 8   /* a force of motion acts, or did a moment ago */
};

struct solution {
    int16_t yaw; /* half turns with 15 fractional bits, as the other angles */
    int16_t pitch;
    int16_t roll;
    uint16_t flags;
};

/* Call once, before the others: the calibration, log2 of the conversions per channel from one solution to
 * the next, and the third tilt axis. */
void solver_start(const int32_t calibration[CALIBRATION_WORDS], uint8_t period_log2, enum third_tilt third_tilt);
/* Somebody knows that the device is upright now. */
void solver_set_upright(void);
/* The attitude from one solution's averages over full scale, with 15 fractional bits (the last is tilt z,
 * where it is measured), and from what the comparator tells of gravity along body z, if a third tilt axis
 * is there: 1 upright, -1 upside down. */
void solve(const int16_t averages[MOST_CHANNELS], int8_t sign, struct solution *solution);

#endif
