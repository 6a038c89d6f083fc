/* solver.h: what device.c asks of a solver; attitude.c and attitude_float.c are two. */
#ifndef SOLVER_H
#define SOLVER_H

#include <stdbool.h>
#include <stdint.h>

/* Sensor channels in conversion order: tilt x, tilt y, field x, field y. */
#define CHANNELS 4
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
    TILT_Z_OFFSET = 15, /* not used: these solvers take the sign of gravity along body z alone */
    TILT_Z_GAIN = 16
};

/* Status bits of a frame. */
enum {
    SATURATION = 1 << 0,   /* a code stood at either end of the scale */
    HALF_SPACE = 1 << 1,   /* the sign of gravity along body z is not known, or upside down */
    DISTURBED = 1 << 2,    /* the readings contradict the Earth's field */
    UNCALIBRATED = 1 << 3, /* no calibration in EEPROM: nominal values */
    DOMAIN = 1 << 4,       /* an inverse function's argument beyond 1 by more than noise, or x / 0 */
    LATE = 1 << 5,         /* a conversion or a solution came late */
    YAW_HELD = 1 << 6      /* yaw is undefined here; the last one is repeated */
};

struct solution {
    int16_t yaw; /* half turns with 15 fractional bits, as the other angles */
    int16_t pitch;
    int16_t roll;
    uint16_t flags;
};

/* Call once, before the others. */
void solver_start(const int32_t calibration[CALIBRATION_WORDS]);
/* Somebody knows that the device is upright now. */
void solver_set_upright(void);
/* The attitude from one solution's averages over full scale, with 15 fractional bits, and from what a
 * third tilt axis tells, the sign of gravity along body z: 1 upright, -1 upside down, 0 if none is fitted. */
void solve(const int16_t averages[CHANNELS], int8_t tilt_z, struct solution *solution);

#endif
