/* fixed.h: fixed-point arithmetic on 16-bit words, with the rounding and limits of most nodes: to
 * nearest with ties up, saturated. A number with `frac` fractional bits is an integer, its value times
 * 2^frac; products add their operands' fractional bits. */
#ifndef FIXED_H
#define FIXED_H

#include <stdbool.h>
#include <stdint.h>

/* A constant as a word with `frac` fractional bits; evaluated by the compiler. */
#define FIXED(value, frac) \
    ((int16_t)((value) * (1L << (frac)) + ((value) < 0 ? -0.5 : 0.5)))

/* raw limited to a word of 16 bits. */
static inline int16_t limit16(int32_t raw)
{
    if (raw > INT16_MAX)
        return INT16_MAX;
    if (raw < INT16_MIN)
        return INT16_MIN;
    return (int16_t)raw;
}

/* raw limited to a word of 31 bits. */
static inline int32_t limit31(int32_t raw)
{
    const int32_t end = (int32_t)1 << 30;

    if (raw >= end)
        return end - 1;
    if (raw < -end)
        return -end;
    return raw;
}

/* raw / 2^places. (Adding half first could overflow.) */
static inline int16_t round_shift(int32_t raw, uint8_t places)
{
    return limit16(((raw >> (places - 1)) + 1) >> 1);
}

static inline int16_t add_limited(int16_t a, int16_t b)
{
    return limit16((int32_t)a + b);
}

static inline int16_t subtract_limited(int16_t a, int16_t b)
{
    return limit16((int32_t)a - b);
}

static inline int16_t negate_limited(int16_t a)
{
    return a == INT16_MIN ? INT16_MAX : (int16_t)-a;
}

static inline int16_t magnitude_limited(int16_t a)
{
    return a < 0 ? negate_limited(a) : a;
}

/* a + b and a - b modulo 2^16: sums of angles in half turns. */
static inline int16_t add_wrapped(int16_t a, int16_t b)
{
    return (int16_t)((uint16_t)a + (uint16_t)b);
}

static inline int16_t subtract_wrapped(int16_t a, int16_t b)
{
    return (int16_t)((uint16_t)a - (uint16_t)b);
}

/* The exact product in a word of 31 bits; only that of the two least words does not fit. */
static inline int32_t product(int16_t a, int16_t b)
{
    return limit31((int32_t)a * b);
}

/* a b / 2^places. */
static inline int16_t multiply_round(int16_t a, int16_t b, uint8_t places)
{
    return round_shift((int32_t)a * b, places);
}

/* a 2^places / b; b is not 0, places at most 15. */
static int16_t divide_round(int16_t a, int16_t b, uint8_t places)
{
    bool is_negative = (a < 0) != (b < 0);
    uint32_t numerator = (uint32_t)(a < 0 ? -(int32_t)a : a) << places;
    uint32_t divisor = (uint32_t)(b < 0 ? -(int32_t)b : b);
    uint32_t quotient = numerator / divisor;
    uint32_t rest = numerator % divisor;
    uint32_t left = divisor - rest;

    /* A tie goes up: away from zero only if the quotient is positive. */
    if (rest > left || (rest == left && !is_negative))
        quotient++;
    return limit16(is_negative ? -(int32_t)quotient : (int32_t)quotient);
}

/* sqrt(radicand), one result bit per step; no ties exist. */
static int16_t square_root(uint32_t radicand)
{
    uint32_t rest = radicand;
    uint32_t root = 0;
    uint32_t bit;

    for (bit = (uint32_t)1 << 30; bit != 0; bit >>= 2) {
        if (rest >= root + bit) {
            rest -= root + bit;
            root = (root >> 1) + bit;
        } else {
            root >>= 1;
        }
    }
    return limit16((int32_t)(root + (rest > root)));
}

#endif
