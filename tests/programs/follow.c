/* PB0 follows PD2 for 20 ms. */
#include <avr/io.h>

int main(void)
{
    DDRB = _BV(PB0);
    TCCR1B = _BV(CS11); /* clock / 8 */
    while (TCNT1 < 40000) {
        if (PIND & _BV(PD2))
            PORTB |= _BV(PB0);
        else
            PORTB &= ~_BV(PB0);
    }
    return 0;
}
