/* device.c: the attitude sensor on the ATmega328P at 16 MHz, around a solver (solver.h).
 *
 * Timer1 counts 0..499 and toggles OC1A (PB1, the 16 kHz carrier) and OC1B (PB2, the strobe, a quarter
 * period later). The same compare match B triggers the converter, which holds 259 cycles later; its
 * interrupt re-arms the trigger, so that a conversion begins every 2000 cycles. 16 conversions of each
 * of 4 channels make a block, every 8 ms; the EEPROM says how many conversions are averaged and after how
 * many a solution follows. PB5 is high while one is computed. Timer2 counts 0..124 of 128 cycles and
 * toggles OC2A (PB3, which tilt channel has the band-pass) and, 12,032 cycles later, OC2B (PD3, it has
 * settled).
 */
#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <string.h>
#include <util/crc16.h>

#include "cardan_tap.h"
#include "solver.h"

#define BLOCK_ROUNDS 16
#define PER_BLOCK (BLOCK_ROUNDS * CHANNELS)
/* Blocks tell themselves apart by the conversion count modulo 256. */
#define BLOCKS (256 / PER_BLOCK)
#define WARM_UP_BLOCKS 12
#define LEAST_PERIOD_LOG2 4
#define MOST_LOG2 12
#define HALF_CARRIER 500
#define STROBE_COUNT 249
#define SELECT_COUNT 124
#define SETTLED_COUNT 93
#define REFERENCE_AVCC _BV(REFS0)
#define CENTRE_CODE 512
#define LAST_CODE 1023

/* ---- Averaging: the interrupt fills one bank of sums while the main loop takes the other. ---- */

static volatile int16_t bank[2][CHANNELS];
static volatile uint8_t turn; /* number of the next conversion */
static volatile uint8_t clipped; /* last conversion with a code at an end of the scale, or the one after */
static volatile uint8_t first = PER_BLOCK; /* first conversion of a block that is summed; none yet */
static uint8_t first_summed; /* the same after the warm-up */
static volatile bool is_late;

ISR(ADC_vect)
{
    uint16_t code = ADC;
    uint8_t now = turn;
    uint8_t half_count;
    int16_t sample;
    volatile int16_t *sum;

    /* First what the next trigger waits for, 269 cycles after the end of a conversion. */
    TIFR1 = _BV(OCF1B);
    half_count = (uint8_t)(TCNT1 >> 1);
    /* A count past the match, in the period after the one in which the conversion ended (at 480). */
    if (half_count >= (STROBE_COUNT + 1) / 2 && half_count < 240)
        is_late = true;
    ADMUX = REFERENCE_AVCC | ((now + 1) % CHANNELS);
    turn = now + 1;
    if (now % PER_BLOCK < first)
        return;
    if (code == 0 || code == LAST_CODE)
        clipped = now | 1;
    sample = (int16_t)code - CENTRE_CODE;
    cardan_tap(NODE_SAMPLE, sample);
    sum = &bank[now / PER_BLOCK % 2][now % CHANNELS];
    *sum += sample;
    cardan_tap(NODE_ACCUMULATOR, *sum);
}

struct block {
    int16_t sums[CHANNELS];
    bool is_clipped;
    bool is_late;
};

/* A complete block's sums, once. Call with interrupts disabled. */
static bool take(struct block *block)
{
    static uint8_t awaited;
    static uint8_t warm_up = WARM_UP_BLOCKS;
    uint8_t current = turn / PER_BLOCK;
    uint8_t ended = (uint8_t)(current - awaited) % BLOCKS;
    uint8_t filled = awaited % 2;
    uint8_t channel;

    if (ended == 0)
        return false;
    awaited = current;
    if (warm_up > 0) {
        warm_up = warm_up > ended ? warm_up - ended : 0;
        if (warm_up == 0)
            first = first_summed;
        is_late = false; /* the first conversion after reset takes longer than the others */
        return false;
    }
    for (channel = 0; channel < CHANNELS; channel++) {
        block->sums[channel] = bank[filled][channel];
        bank[filled][channel] = 0;
    }
    block->is_clipped = clipped != 0;
    if (clipped / PER_BLOCK == (uint8_t)(current - 1) % BLOCKS)
        clipped = 0;
    block->is_late = is_late || ended > 1;
    is_late = false;
    return true;
}

/* Sleeps until a block's sums are complete. */
static void wait(struct block *block)
{
    for (;;) {
        bool is_taken;

        cli();
        is_taken = take(block);
        sei();
        /* SEI lets one more instruction run, SLEEP: no interrupt comes in between. */
        if (is_taken)
            return;
        sleep_cpu();
    }
}

/* The blocks of a period, and how many at its end count. */
static uint16_t period;
static uint16_t counted;
/* A sum takes so many fractional bits of the average over full scale, of 21: exact up to 4096. */
static uint8_t scale;

static void start_averaging(uint8_t log2, uint8_t period_log2)
{
    uint8_t summed = log2 < LEAST_PERIOD_LOG2 ? log2 : LEAST_PERIOD_LOG2;

    first_summed = PER_BLOCK - (CHANNELS << summed);
    period = (uint16_t)1 << (period_log2 - LEAST_PERIOD_LOG2);
    counted = (uint16_t)1 << (log2 - summed);
    scale = MOST_LOG2 - log2;
}

struct averages {
    int16_t values[MOST_CHANNELS]; /* over full scale, with 15 fractional bits; the last is always 0 */
    bool is_clipped;
    bool is_late;
};

/* Sleeps until a solution's averages are complete. */
static void average(struct averages *averages)
{
    int32_t means[CHANNELS] = {0};
    uint16_t left;
    uint8_t channel;

    averages->values[CHANNELS] = 0;
    averages->is_clipped = false;
    averages->is_late = false;
    for (left = period; left > 0; left--) {
        struct block block;

        wait(&block);
        averages->is_late |= block.is_late;
        if (left > counted)
            continue;
        averages->is_clipped |= block.is_clipped;
        for (channel = 0; channel < CHANNELS; channel++) {
            int32_t part = (int32_t)block.sums[channel] * ((int32_t)1 << scale);

            cardan_tap(NODE_BLOCK, part);
            means[channel] += part;
            cardan_tap(NODE_MEAN, means[channel]);
        }
    }
    for (channel = 0; channel < CHANNELS; channel++) {
        /* Half a place up; a code less than full scale leaves room for it. */
        averages->values[channel] = (int16_t)(((means[channel] >> 5) + 1) >> 1);
        cardan_tap(NODE_AVERAGE, averages->values[channel]);
    }
}

/* ---- Serial line: 115200 8N1; a message goes out byte by byte from its interrupt. ---- */

#define MESSAGE_LEN 48
#define RECEIVE_AND_SEND (_BV(TXEN0) | _BV(RXEN0))

static volatile uint8_t message[MESSAGE_LEN];
static volatile uint8_t message_next;
static volatile uint8_t message_len;

ISR(USART_UDRE_vect)
{
    uint8_t next = message_next;

    if (next < message_len) {
        UDR0 = message[next];
        message_next = next + 1;
    } else {
        UCSR0B = RECEIVE_AND_SEND;
    }
}

/* Sends a message of at most MESSAGE_LEN bytes, unless another is still going out. */
static void send(const uint8_t *bytes, uint8_t len)
{
    uint8_t i;

    if (UCSR0B & _BV(UDRIE0))
        return;
    for (i = 0; i < len; i++)
        message[i] = bytes[i];
    message_next = 0;
    message_len = len;
    UCSR0B = RECEIVE_AND_SEND | _BV(UDRIE0);
}

/* ---- Frames: 20 bytes, COBS-encoded, ended by a zero byte; or text lines. ---- */

#define PAYLOAD_LEN 20
#define WIRE_LEN (PAYLOAD_LEN + 2)

static uint16_t crc16(const uint8_t *bytes, uint8_t len)
{
    uint16_t crc = 0xffff;

    while (len-- > 0)
        crc = _crc_xmodem_update(crc, *bytes++);
    return crc;
}

/* The controller is little-endian, as the frame. */
static uint8_t *put(uint8_t *to, uint16_t word)
{
    memcpy(to, &word, sizeof word);
    return to + sizeof word;
}

static void send_frame(uint16_t sequence, const int16_t averages[CHANNELS], const struct solution *solution)
{
    uint8_t payload[PAYLOAD_LEN];
    uint8_t wire[WIRE_LEN];
    uint8_t *to = put(payload, sequence);
    uint8_t i, start = 0;

    for (i = 0; i < CHANNELS; i++)
        to = put(to, (uint16_t)averages[i]);
    to = put(to, (uint16_t)solution->yaw);
    to = put(to, (uint16_t)solution->pitch);
    to = put(to, (uint16_t)solution->roll);
    to = put(to, solution->flags);
    put(to, crc16(payload, PAYLOAD_LEN - 2));

    /* COBS: each zero is replaced by the distance to the next one. */
    wire[0] = 1;
    for (i = 0; i < PAYLOAD_LEN; i++) {
        if (payload[i] == 0) {
            start = i + 1;
            wire[start] = 1;
        } else {
            wire[start]++;
            wire[i + 1] = payload[i];
        }
    }
    wire[WIRE_LEN - 1] = 0;
    send(wire, WIRE_LEN);
}

static uint8_t *decimal(uint8_t *to, int32_t value)
{
    static const uint16_t powers[] = {10000, 1000, 100, 10, 1};
    uint16_t rest = (uint16_t)(value < 0 ? -value : value);
    bool is_started = false;
    uint8_t i;

    if (value < 0)
        *to++ = '-';
    for (i = 0; i < 5; i++) {
        uint8_t digit = '0';

        for (; rest >= powers[i]; rest -= powers[i])
            digit++;
        is_started |= digit != '0' || powers[i] == 1;
        if (is_started)
            *to++ = digit;
    }
    return to;
}

/* Sequence, yaw, pitch, roll in hundredths of a degree, status bits. */
static void send_text(uint16_t sequence, const struct solution *solution)
{
    const int16_t angles[3] = {solution->yaw, solution->pitch, solution->roll};
    uint8_t line[MESSAGE_LEN];
    uint8_t *to = decimal(line, sequence);
    int8_t i;

    for (i = 0; i < 3; i++) {
        *to++ = ' ';
        to = decimal(to, ((int32_t)angles[i] * 1125 + 1024) >> 11);
    }
    memcpy(to, " 0x", 3);
    to += 3;
    for (i = 12; i >= 0; i -= 4)
        *to++ = "0123456789abcdef"[solution->flags >> i & 15];
    *to++ = '\r';
    *to++ = '\n';
    send(line, (uint8_t)(to - line));
}

/* ---- Settings: from EEPROM, else nominal sensors at the reference site. ---- */

#define MAGIC 0xCA1D
#define VERSION 4

struct calibration_image {
    uint16_t magic;
    uint8_t version;
    uint8_t count;
    uint8_t averaging_log2;
    uint8_t period_log2;
    uint8_t options;
    int32_t words[CALIBRATION_WORDS];
    uint16_t crc;
};

static const int32_t NOMINAL[CALIBRATION_WORDS] = {
    -262144, -262144,            /* offset -0.5 / 512: the converter's floor */
    -322122547, 0, 0, -322122547, /* 1.2 g at full scale, minus gravity */
    -262144, -262144,
    344059800, 0, 0, 344059800,   /* 60 uT at full scale over 46.812 uT */
    136672021, 231036156,         /* cosine and sine of the inclination */
    527230031,                    /* 1 / cosine */
    -262144, -322122547           /* tilt z */
};

/* Starts the solver; returns the status bits that every frame gets. */
static uint16_t start_solver(void)
{
    struct calibration_image image;

    eeprom_read_block(&image, (const void *)0, sizeof image);
    if (image.magic == MAGIC && image.version == VERSION && image.count == CALIBRATION_WORDS &&
        image.averaging_log2 <= image.period_log2 && image.period_log2 >= LEAST_PERIOD_LOG2 &&
        image.period_log2 <= MOST_LOG2 && image.options <= COMPARATOR &&
        image.crc == crc16((const uint8_t *)&image, sizeof image - sizeof image.crc)) {
        start_averaging(image.averaging_log2, image.period_log2);
        solver_start(image.words, image.period_log2, image.options);
        return 0;
    }
    start_averaging(LEAST_PERIOD_LOG2, LEAST_PERIOD_LOG2);
    solver_start(NOMINAL, LEAST_PERIOD_LOG2, ABSENT);
    return UNCALIBRATED;
}

/* ---- The device. ---- */

static void start_serial(void)
{
    UBRR0 = 16; /* 117,647 baud */
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = RECEIVE_AND_SEND;
}

static void start_pins(void)
{
    DDRB = _BV(PB1) | _BV(PB2) | _BV(PB3) | _BV(PB5);
    DDRD = _BV(PD3);
    SMCR = _BV(SE); /* idle: the clocks of timer, converter and USART run on */
}

static void start_converter(void)
{
    ADMUX = REFERENCE_AVCC;
    DIDR0 = 0x0f;
    ADCSRB = _BV(ADTS2) | _BV(ADTS0); /* triggered by compare match B */
    ADCSRA = _BV(ADEN) | _BV(ADATE) | _BV(ADIE) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
}

/* Mode 12 first: ICR1 can be written only in a mode that uses it as TOP (data sheet, 16.6.3). */
static void start_carrier(void)
{
    TCCR1A = _BV(COM1A0) | _BV(COM1B0);
    TCCR1B = _BV(WGM13) | _BV(WGM12);
    ICR1 = HALF_CARRIER - 1;
    OCR1A = HALF_CARRIER - 1;
    OCR1B = STROBE_COUNT;
    TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS10);
}

/* After the carrier: a turn begins with its edge, so the prescaler starts anew. The reset comes first: a
 * tick before it would count. */
static void start_turns(void)
{
    GTCCR = _BV(PSRASY);
    TCCR2B = _BV(CS22) | _BV(CS20);
}

static void prepare_turns(void)
{
    OCR2A = SELECT_COUNT;
    OCR2B = SETTLED_COUNT;
    TCCR2A = _BV(COM2A0) | _BV(COM2B0) | _BV(WGM21);
}

/* Returns whether frames are text from now on. */
static bool obey(bool is_text)
{
    if (!(UCSR0A & _BV(RXC0)))
        return is_text;
    switch (UDR0) {
    case 't':
        return true;
    case 'b':
        return false;
    case 'u':
        solver_set_upright();
    }
    return is_text;
}

/* The third tilt axis at the comparator: AIN0 above AIN1, mid supply, is upside down. */
static int8_t sign_of_z(void)
{
    return ACSR & _BV(ACO) ? -1 : 1;
}

int main(void)
{
    uint16_t always = start_solver();
    uint16_t sequence = 0;
    bool is_text = false;

    start_serial();
    start_pins();
    /* Last, so that the first conversion's interrupt does not wait for the start. */
    start_converter();
    prepare_turns();
    start_carrier();
    start_turns();
    sei();
    for (;; sequence++) {
        struct averages averages;
        struct solution solution;

        average(&averages);
        is_text = obey(is_text);
        PORTB |= _BV(PB5);
        solve(averages.values, sign_of_z(), &solution);
        solution.flags |= always;
        if (averages.is_clipped)
            solution.flags |= SATURATION;
        if (averages.is_late)
            solution.flags |= LATE;
        PORTB &= (uint8_t)~_BV(PB5);
        if (is_text)
            send_text(sequence, &solution);
        else
            send_frame(sequence, averages.values, &solution);
    }
}
