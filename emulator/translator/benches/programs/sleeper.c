/* Mostly asleep: a Timer0 interrupt starts a conversion, its end sends two bytes, and the
 * processor idles in between. The converter is on only while it converts: with ADEN set, entering
 * Idle would start a conversion by itself (data sheet 10.3), which simavr does not model. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <stdint.h>

static volatile uint16_t code;
static volatile uint8_t pending;

ISR(TIMER0_COMPA_vect) { ADCSRA = (1 << ADEN) | (1 << ADSC) | (1 << ADIE) | 7; }
ISR(ADC_vect)
{
	code = ADC;
	ADCSRA = 0;
	pending = 2;
	UCSR0B |= 1 << UDRIE0;
}
ISR(USART_UDRE_vect)
{
	UDR0 = pending == 2 ? code >> 8 : code;
	if (--pending == 0)
		UCSR0B &= ~(1 << UDRIE0);
}

int main(void)
{
	UBRR0 = 16;
	UCSR0A = 1 << U2X0;
	UCSR0B = 1 << TXEN0;
	ADMUX = 1 << REFS0;
	OCR0A = 249;
	TCCR0A = 1 << WGM01;
	TCCR0B = 3;
	TIMSK0 = 1 << OCIE0A;
	set_sleep_mode(SLEEP_MODE_IDLE);
	sei();
	for (;;)
		sleep_mode();
}
