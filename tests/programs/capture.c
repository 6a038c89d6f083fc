/* Captures both edges of PB0 (ICP1) to the cycle and sends them: high byte, low byte. */
#include <avr/io.h>

static void send(unsigned char byte)
{
    while (!(UCSR0A & _BV(UDRE0)))
        ;
    UDR0 = byte;
}

int main(void)
{
    UBRR0 = 0;
    UCSR0A = _BV(U2X0);
    UCSR0B = _BV(TXEN0);
    TCCR1B = _BV(ICES1) | _BV(CS10);
    for (unsigned char edges = 0; edges < 32; edges++) {
        while (!(TIFR1 & _BV(ICF1)))
            ;
        unsigned at = ICR1;
        TCCR1B ^= _BV(ICES1);
        TIFR1 = _BV(ICF1);
        send(at >> 8);
        send(at);
    }
    return 0;
}
