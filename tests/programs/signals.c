/* Changes variables, a register and a pin. */
#include <avr/io.h>

volatile unsigned counter;
volatile signed char level;
volatile unsigned char table[9];

int main(void)
{
    DDRB = _BV(PB0);
    for (unsigned char i = 0; i < 40; i++) {
        counter += 1000;
        level -= 3;
        table[0] = i;
        PORTB ^= _BV(PB0);
        OCR1A = counter;
    }
    return 0;
}
