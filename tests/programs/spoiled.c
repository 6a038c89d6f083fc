/* Two interrupt handlers: a clean one, and one that spoils r2 and SREG. Sleeps in between. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

volatile unsigned ticks;

ISR(TIMER1_COMPA_vect) { ticks++; }

ISR(TIMER0_OVF_vect, ISR_NAKED)
{
    __asm__ volatile("inc r2\n\treti");
}

int main(void)
{
    DDRB = _BV(PB5);
    TIMSK0 = _BV(TOIE0);
    TCCR0B = _BV(CS00);
    OCR1A = 999;
    TIMSK1 = _BV(OCIE1A);
    TCCR1B = _BV(WGM12) | _BV(CS10);
    sei();
    while (ticks < 20) {
        sleep_mode();
        PINB = _BV(PB5);
    }
    cli();
    return 0;
}
