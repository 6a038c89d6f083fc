/* Endless, or with ROUNDS so many rounds and then one byte over the serial line: for simulators that
 * count no cycles. */
#include <avr/io.h>
#include <stdint.h>

#ifdef ROUNDS
#define EACH_ROUND for (uint32_t round = 0; round < ROUNDS; round++)
#define END() do { UCSR0B = 1 << TXEN0; UDR0 = '!'; for (;;); } while (0)
#else
#define EACH_ROUND for (;;)
#define END() do { } while (0)
#endif
