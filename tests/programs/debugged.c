// What a debugger looks at: nested calls, a variable, I/O registers, interrupts, serial output.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <stdint.h>

volatile uint16_t ticks;
volatile uint8_t total;

ISR(TIMER0_COMPA_vect) { ticks++; }

__attribute__((noinline)) uint8_t inner(uint8_t x) {
    total += x;
    return x * 2;
}

__attribute__((noinline)) uint8_t outer(uint8_t x) {
    uint8_t y = inner(x + 1);
    return y + 1;
}

static void put(char c) {
    while (!(UCSR0A & _BV(UDRE0))) {
    }
    UDR0 = c;
}

int main(void) {
    UBRR0 = 8;
    UCSR0B = _BV(TXEN0) | _BV(RXEN0);
    DDRB = 0xFF;
    OCR0A = 199;
    TCCR0A = _BV(WGM01);
    TIMSK0 = _BV(OCIE0A);
    TCCR0B = _BV(CS00);
    sei();
    for (uint8_t i = 0; i < 5; i++) {
        put('a' + i);
        PORTB = outer(i);
    }
    while (ticks < 200) {
    }
    cli();
    return total;
}
