/* Pulses of many lengths on PB0. */
#include <avr/io.h>
#define F_CPU 16000000UL
#include <util/delay_basic.h>

int main(void)
{
    DDRB = _BV(PB0);
    for (unsigned pause = 300; pause < 9000; pause += 271) {
        _delay_loop_2(pause);
        PINB = _BV(PB0);
    }
    return 0;
}
