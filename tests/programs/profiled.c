/* Samples input 0 in an interrupt, sleeps in between, and filters in the main loop. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

volatile unsigned sample;
volatile unsigned char fresh;
unsigned average;

ISR(ADC_vect)
{
    sample = ADC;
    fresh = 1;
}

static inline unsigned quarter(unsigned value)
{
    return value >> 2;
}

__attribute__((noinline)) void filter(unsigned value)
{
    average += quarter(value) - quarter(average);
}

__attribute__((noinline)) unsigned never(unsigned value)
{
    return value * 3;
}

int main(void)
{
    unsigned left = 500;
    ADMUX = _BV(REFS0);
    ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADATE) | _BV(ADIE) | 7;
    sei();
    while (left) {
        sleep_mode();
        if (!fresh)
            continue;
        fresh = 0;
        filter(sample);
        if (sample > 2000)
            average = never(average);
        left--;
    }
    cli();
    return average >> 2;
}
