/* Sends a line, then ends with exit code 42. */
#include <avr/io.h>

int main(void)
{
    UBRR0 = 16;
    UCSR0A = _BV(U2X0);
    UCSR0B = _BV(TXEN0);
    for (const char *next = "hello\n"; *next; next++) {
        while (!(UCSR0A & _BV(UDRE0)))
            ;
        UDR0 = *next;
    }
    return 42;
}
