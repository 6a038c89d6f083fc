/* Converts inputs 0 and 3 against AVCC, 10 ms later input 0 again, and sends the codes. */
#include <avr/io.h>
#define F_CPU 16000000UL
#include <util/delay.h>

static void send(unsigned char byte)
{
    while (!(UCSR0A & _BV(UDRE0)))
        ;
    UDR0 = byte;
}

static void convert(unsigned char input)
{
    ADMUX = _BV(REFS0) | input;
    ADCSRA = _BV(ADEN) | _BV(ADSC) | 7;
    while (ADCSRA & _BV(ADSC))
        ;
    unsigned code = ADC;
    send(code);
    send(code >> 8);
}

int main(void)
{
    UBRR0 = 16;
    UCSR0A = _BV(U2X0);
    UCSR0B = _BV(TXEN0);
    convert(0);
    convert(3);
    _delay_ms(10);
    convert(0);
    return 0;
}
