/* Interrupt load: a 16 kHz Timer1 interrupt with some work, and a main loop that computes. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <stdint.h>

volatile uint16_t ticks;
volatile int32_t filter;
volatile uint32_t result;

ISR(TIMER1_COMPA_vect)
{
	ticks++;
	int32_t state = filter;
	state += ((int32_t)(ticks & 1023) - (state >> 4));
	filter = state;
	PORTB ^= 1;
}

int main(void)
{
	uint32_t lcg = 1;
	DDRB = 1;
	OCR1A = 999;
	TCCR1B = (1 << WGM12) | 1;
	TIMSK1 = 1 << OCIE1A;
	sei();
	for (;;) {
		lcg = lcg * 1664525UL + 1013904223UL;
		result = lcg;
	}
}
