/* smooth.c: a firmware of one's own. It smooths the codes of ADC0, s += (code - s) / 8, in 16-bit fixed
 * point with 5 fractional bits, and publishes what it computes with cardan_tap.h. At the end it sends the
 * result, in codes, over the serial line.
 */
#include <avr/io.h>
#include <stdint.h>
#include <stdlib.h>

#include "cardan_tap.h"

#define SAMPLES 100
#define FRACTION 5
#define SHIFT 3

/* The tables by which a host finds formats and values. */
CARDAN_TABLES;

static int16_t converted(void)
{
    ADCSRA |= _BV(ADSC);
    loop_until_bit_is_clear(ADCSRA, ADSC);
    return (int16_t)ADC;
}

static void send(const char *text)
{
    for (; *text; text++) {
        loop_until_bit_is_set(UCSR0A, UDRE0);
        UDR0 = (uint8_t)*text;
    }
}

int main(void)
{
    int16_t smooth = 0;
    char text[8];

    UBRR0 = 8; /* 115200 baud at 16 MHz */
    UCSR0B = _BV(TXEN0);
    ADMUX = _BV(REFS0);                              /* reference: the supply, 5 V */
    ADCSRA = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0); /* 125 kHz: 9615 samples a second */
    for (uint8_t count = 0; count < SAMPLES; count++) {
        int16_t sample = converted();
        cardan_tap(NODE_SAMPLE, sample);
        smooth += ((sample << FRACTION) - smooth + (1 << (SHIFT - 1))) >> SHIFT;
        cardan_tap(NODE_SMOOTH, smooth);
    }
    send(itoa(smooth >> FRACTION, text, 10));
    send("\n");
    UCSR0A = _BV(TXC0);
    return 0;
}
