/* Fast PWM on OC1A (PB1), 64 of 256 cycles high. It needs no program: main has nothing left to do. */
#include <avr/io.h>

int main(void)
{
    DDRB = _BV(PB1);
    OCR1A = 63;
    TCCR1A = _BV(COM1A1) | _BV(WGM10);
    TCCR1B = _BV(WGM12) | _BV(CS10);
    for (;;) {
    }
}
