/* Takes its time, then sends back what it receives, until a 'q'. */
#include <avr/io.h>
#define F_CPU 16000000UL
#include <util/delay.h>

int main(void)
{
    unsigned char byte;
    _delay_ms(120);
    UBRR0 = 16;
    UCSR0A = _BV(U2X0);
    UCSR0B = _BV(TXEN0) | _BV(RXEN0);
    do {
        while (!(UCSR0A & _BV(RXC0)))
            ;
        byte = UDR0;
        while (!(UCSR0A & _BV(UDRE0)))
            ;
        UDR0 = byte;
    } while (byte != 'q');
    return 0;
}
