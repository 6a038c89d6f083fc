/* Converts input 0 against AREF, AVCC and the bandgap, and sends the codes, high byte first. */
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
    for (unsigned char selection = 0; selection < 4; selection++) {
        if (selection == 2)
            continue; /* reserved */
        ADMUX = selection << REFS0;
        ADCSRA = _BV(ADEN) | _BV(ADSC) | 7;
        while (ADCSRA & _BV(ADSC))
            ;
        unsigned code = ADC;
        send(code >> 8);
        send(code);
    }
    return 0;
}
