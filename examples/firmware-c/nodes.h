/* nodes.h: the nodes of smooth.c, as cardan_tap.h reads them.
 *
 * X(NAME, word length, fractional bits, rounding, overflow), in the order of their numbers: the first is 0.
 * The hash tells one set of formats from another. `cardan compare` holds it against the native firmware's;
 * a bench of your own may use it in the same way or not at all. Change it when you change a format.
 */
#ifndef CARDAN_NODES_H
#define CARDAN_NODES_H

#define CARDAN_FORMATS_HASH 0x0000000000000001ULL

#define CARDAN_NODES(X) \
    X(SAMPLE, 16, 0, FLOOR, WRAP) \
    X(SMOOTH, 16, 5, NEAREST_UP, WRAP)

#endif
