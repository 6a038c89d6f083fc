/* cardan_tap.h: how C firmware shows Cardan its intermediate values.
 *
 * `cardan compare --firmware yours.elf` runs your image in the emulator and compares every value that
 * it publishes, bit by bit, with the native firmware's. For that an image carries two things:
 *
 *   CARDAN_FORMATS   a table in flash: a hash, and each node's word length, fractional bits, rounding
 *                    and overflow. Formats that are not the native firmware's are refused with both
 *                    sides named, before anything runs.
 *   CARDAN_TAPS      a table in SRAM: one int32_t per node. To publish a value, the firmware stores it
 *                    there and writes the node's index to GPIOR0. The emulator sees that write and
 *                    reads the word; on a real chip it is a write to a scratch register.
 *
 * How to use it (attitude.c beside this file is an example):
 *
 *   1. #include "cardan_tap.h" wherever values are published. It includes nodes.h, which names the
 *      nodes: NODE_SAMPLE, NODE_TILT_X, ... `cargo xtask c-header` writes nodes.h from
 *      firmware/wordlengths.toml; run it again when that file has changed.
 *   2. Write CARDAN_TABLES; once, in one C file, outside all functions.
 *   3. Call cardan_tap(NODE_TILT_X, tilt_x) each time a node takes a value, also inside loops: a node's
 *      values are compared in their order. The order of different nodes does not matter.
 *
 * Build with -DCARDAN_NO_TAPS to leave the taps out: no SRAM, no cycles. `compare` then compares the
 * frames only, and its report says so. The format table stays, so that formats are still checked.
 *
 * A node is written either by one interrupt or by the main loop, never by both. GPIOR0 belongs to the
 * taps. If you link with --gc-sections, add -Wl,--undefined=CARDAN_FORMATS: nothing refers to it.
 */
#ifndef CARDAN_TAP_H
#define CARDAN_TAP_H

#include <avr/io.h>
#include <avr/pgmspace.h>
#include <stdint.h>

#include "nodes.h"

/* Roundings and overflows, as numbered in the format table. */
enum {
    CARDAN_FLOOR = 0,        /* toward minus infinity */
    CARDAN_CEIL = 1,         /* toward plus infinity */
    CARDAN_ZERO = 2,         /* toward zero */
    CARDAN_NEAREST_UP = 3,   /* to nearest, ties toward plus infinity */
    CARDAN_NEAREST_AWAY = 4, /* to nearest, ties away from zero */
    CARDAN_NEAREST_EVEN = 5, /* to nearest, ties to even */
    CARDAN_WRAP = 0,         /* modulo the word */
    CARDAN_SATURATE = 1,     /* to the nearest end of the word */
    CARDAN_TRAP = 2          /* as saturate, and an error */
};

/* Node indices. CARDAN_NODES is the list in nodes.h: one X(NAME, word, frac, rounding, overflow) each. */
#define CARDAN_INDEX(name, word, frac, rounding, overflow) NODE_##name,
enum cardan_node { CARDAN_NODES(CARDAN_INDEX) NODE_COUNT };

/* CARDAN_TABLES; defines the tables. */
#define CARDAN_ROW(name, word, frac, rounding, overflow) \
    word, frac, CARDAN_##rounding, CARDAN_##overflow,
#define CARDAN_HASH_BYTE(n) (uint8_t)(CARDAN_FORMATS_HASH >> (8 * (n)))
#define CARDAN_FORMAT_TABLE                                                                  \
    const uint8_t CARDAN_FORMATS[10 + 4 * NODE_COUNT] PROGMEM __attribute__((used)) = {      \
        CARDAN_HASH_BYTE(0), CARDAN_HASH_BYTE(1), CARDAN_HASH_BYTE(2), CARDAN_HASH_BYTE(3),  \
        CARDAN_HASH_BYTE(4), CARDAN_HASH_BYTE(5), CARDAN_HASH_BYTE(6), CARDAN_HASH_BYTE(7),  \
        (uint8_t)NODE_COUNT, (uint8_t)(NODE_COUNT >> 8), CARDAN_NODES(CARDAN_ROW)            \
    }

#ifdef CARDAN_NO_TAPS

#define CARDAN_TABLES CARDAN_FORMAT_TABLE

static inline void cardan_tap(enum cardan_node node, int32_t raw)
{
    (void)node;
    (void)raw;
}

#else

#define CARDAN_TABLES CARDAN_FORMAT_TABLE; volatile int32_t CARDAN_TAPS[NODE_COUNT]

extern volatile int32_t CARDAN_TAPS[NODE_COUNT];

/* Publishes that `node` has taken the value raw / 2^frac of its format. */
static inline void cardan_tap(enum cardan_node node, int32_t raw)
{
    CARDAN_TAPS[node] = raw;
    GPIOR0 = (uint8_t)node;
}

#endif

#endif
