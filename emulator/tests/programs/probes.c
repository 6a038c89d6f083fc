/* Timing probes by the data sheet: each stores what it measured, in cycles of Timer1 at clk/1
 * unless it counts something else. tests/probes.rs holds the expected values and their sources. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <stdint.h>

volatile uint16_t result[64];
volatile uint16_t stamp;
volatile uint8_t seen, limit;

/* Cycles of `code`, less those of the frame: measured by two reads of TCNT1. */
#define MEASURE(index, code) do { \
	uint16_t a, b; \
	asm volatile("lds %A0, 0x84\n lds %B0, 0x85\n" code "\nlds %A1, 0x84\n lds %B1, 0x85\n" \
		: "=&r"(a), "=&r"(b) : : "r0", "r18", "r19", "r20", "r21", "r24", "r25", "r26", "r27", "r30", "r31", "memory"); \
	result[index] = b - a - 4; \
} while (0)

ISR(TIMER1_COMPA_vect, ISR_NAKED) { asm volatile("reti"); }
ISR(TIMER1_COMPB_vect) { stamp = TCNT1; seen++; }
ISR(TIMER0_OVF_vect) { seen++; }
ISR(USART_UDRE_vect, ISR_NAKED)
{
	asm volatile(
		"push r24\n in r24, __SREG__\n push r24\n"
		"lds r24, seen\n inc r24\n sts seen, r24\n"
		"lds r25, limit\n cp r24, r25\n brlo 1f\n"
		"ldi r24, 0\n sts 0xC1, r24\n"
		"1: pop r24\n out __SREG__, r24\n pop r24\n reti\n");
}
ISR(ADC_vect) { stamp = ADC; seen++; TIFR0 = 1 << OCF0A; }

static void instructions(void)
{
	MEASURE(0, "nop");
	MEASURE(1, "sbi 0x1e, 0");
	MEASURE(2, "cbi 0x1e, 0");
	MEASURE(3, "rcall 1f\n rjmp 2f\n 1: ret\n 2:");     /* 3 + 4 + 2 */
	MEASURE(4, "ldi r24, 3\n mul r24, r24");             /* 1 + 2 */
	MEASURE(5, "sbic 0x1e, 7\n lds r24, 0x100");        /* skip two words: 3 */
	MEASURE(6, "lpm r24, Z");
	MEASURE(7, "cpse r1, r1\n nop");                    /* 2 */
	MEASURE(8, "push r24\n pop r24");                   /* 4 */
	MEASURE(9, "adiw r24, 1");
	MEASURE(10, "call 1f\n rjmp 2f\n 1: ret\n 2:");     /* 4 + 4 + 2 */
	MEASURE(11, "ldi r30, lo8(pm(1f))\n ldi r31, hi8(pm(1f))\n ijmp\n 1:"); /* 4 */
}

static void interrupts(void)
{
	/* ISR entry 4, JMP 3, RETI 4: 11 cycles, seen as extra time of a line of NOPs. */
	uint16_t plain, with;
	TIMSK1 = 0;
	cli();
#define NOPS "nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n"
#define LINE(into) asm volatile("lds r18, 0x84\n lds r19, 0x85\n" NOPS "lds %A0, 0x84\n lds %B0, 0x85\n" \
		"sub %A0, r18\n sbc %B0, r19\n" : "=&r"(into) : : "r18", "r19")
	LINE(plain);
	OCR1A = TCNT1 + 40;
	TIFR1 = 1 << OCF1A;
	TIMSK1 = 1 << OCIE1A;
	sei();
	LINE(with);
	LINE(with);
	cli();
	TIMSK1 = 0;
	/* The compare lies in one of the two lines: measure again over both. */
	OCR1A = TCNT1 + 30;
	TIFR1 = 1 << OCF1A;
	TIMSK1 = 1 << OCIE1A;
	sei();
	LINE(with);
	cli();
	TIMSK1 = 0;
	result[12] = with - plain;

	/* A flag set first and enabled later still interrupts. */
	seen = 0;
	TCCR0B = 1;
	while (!(TIFR0 & 1)) ;
	sei();
	TIMSK0 = 1;
	asm volatile("nop\n nop");
	TIMSK0 = 0;
	cli();
	TCCR0B = 0;
	result[13] = seen;

	/* One instruction runs after SEI; SEI, CLI takes none. */
	TIFR1 = 0x27;
	OCR1B = TCNT1 + 20;
	asm volatile(NOPS NOPS);
	seen = 0;
	TIMSK1 = 1 << OCIE1B;
	asm volatile("sei\n cli");
	result[14] = seen;
	uint8_t count = 0;
	asm volatile("sei\n inc %0\n lds r18, seen\n cli\n" : "+r"(count) : : "r18");
	result[15] = seen;
	TIMSK1 = 0;
	cli();
}

static void wake(void)
{
	/* Latency from compare to the ISR's TCNT1 read, awake (in NOPs) and asleep. */
	uint16_t awake, asleep;
	OCR1B = TCNT1 + 60;
	TIFR1 = 0x27;
	TIMSK1 = 1 << OCIE1B;
	seen = 0;
	sei();
	asm volatile(NOPS NOPS NOPS NOPS);
	cli();
	awake = stamp - OCR1B;
	set_sleep_mode(SLEEP_MODE_IDLE);
	sleep_enable();
	OCR1B = TCNT1 + 200;
	TIFR1 = 0x27;
	sei();
	sleep_cpu();
	cli();
	asleep = stamp - OCR1B;
	TIMSK1 = 0;
	result[16] = asleep - awake;
	/* SLEEP without SE is a NOP. */
	sleep_disable();
	MEASURE(17, "sleep");
}

static void level(void)
{
	/* The level interrupt UDRE lets one instruction of main run per ISR. */
	seen = 0;
	limit = 10;
	uint8_t main_steps = 0;
	UCSR0B = (1 << TXEN0) | (1 << UDRIE0);
	asm volatile("sei\n" 
		"inc %0\n inc %0\n inc %0\n inc %0\n inc %0\n inc %0\n inc %0\n inc %0\n inc %0\n inc %0\n inc %0\n inc %0\n"
		: "+r"(main_steps) : : "r24", "r25");
	cli();
	result[18] = seen;
}

static void timers(void)
{
	/* TCNT == OCR written while the timer stands still: no match. */
	TCCR0A = 0; TCCR0B = 0;
	OCR0A = 50;
	TCNT0 = 50;
	TIFR0 = 7;
	TCCR0B = 1;
	asm volatile("nop\n nop\n nop");
	TCCR0B = 0;
	result[19] = TIFR0 & (1 << OCF0A);
	/* TCNT survives a change of CS. */
	TCNT0 = 48;
	TCCR0B = 5;
	TCCR0B = 3;
	TCCR0B = 0;
	result[20] = TCNT0;
	/* TSM holds the timer. */
	GTCCR = (1 << TSM) | (1 << PSRSYNC);
	TCNT0 = 0;
	TCCR0B = 2;
	asm volatile(NOPS NOPS NOPS NOPS NOPS);
	result[21] = TCNT0;
	GTCCR = 0;
	/* Prescaler phase: reset it, let 10 cycles pass, start at /64. */
	TCCR0B = 0;
	TCNT0 = 0;
	GTCCR = 1 << PSRSYNC;
	asm volatile("nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop");
	TCCR0B = 3;
	uint16_t start = TCNT1;
	while (TCNT0 == 0) ;
	result[22] = TCNT1 - start;
	TCCR0B = 0;
	/* Fast PWM buffers OCR until BOTTOM. */
	TCCR0A = 3;
	OCR0A = 200;
	TCNT0 = 254;
	TCCR0B = 2;
	while (TCNT0 > 100) ;
	TIFR0 = 7;
	OCR0A = 20;          /* takes effect at the next BOTTOM only */
	while (TCNT0 < 100) ;
	result[23] = TIFR0 & (1 << OCF0A);
	TCCR0B = 0;
	TCCR0A = 0;
	/* Phase-correct period of Timer2: 510 clocks between two overflows. */
	TCCR2A = 1;
	TCCR2B = 1;
	TCNT2 = 0;
	while (!(TIFR2 & 1)) ;
	TIFR2 = 1;
	start = TCNT1;
	while (!(TIFR2 & 1)) ;
	result[24] = TCNT1 - start;
	TCCR2B = 0;
	TCCR2A = 0;
	/* Silicon: STS TCCR2B,1; NOP; LDS TCNT2 reads 2 (avr8js issue 41). */
	uint8_t value;
	TCNT2 = 0;
	asm volatile("ldi r18, 1\n sts 0xB1, r18\n nop\n lds %0, 0xB2\n" : "=r"(value) : : "r18");
	result[25] = value;
	TCCR2B = 0;
	/* Silicon: TCCR2B = 1; TCCR2B = 0; then TCNT2 reads 2 (avr8js issue 72). */
	TCNT2 = 0;
	asm volatile("ldi r18, 1\n sts 0xB1, r18\n sts 0xB1, r1\n nop\n lds %0, 0xB2\n" : "=r"(value) : : "r18");
	result[26] = value;
	/* Silicon: OUT TCNT0, 0; IN TCNT0 at clk/1 reads 0 (avr8js issue 36). */
	TCCR0B = 1;
	asm volatile("out 0x26, r1\n in %0, 0x26\n" : "=r"(value));
	result[27] = value;
	TCCR0B = 0;
}

static void pins(void)
{
	uint8_t before, after;
	DDRB = 1;
	PORTB = 0;
	asm volatile("sbi 0x05, 0\n in %0, 0x03\n in %1, 0x03\n" : "=r"(before), "=r"(after));
	result[28] = before & 1;
	result[29] = after & 1;
	/* SBI on PINx toggles one pin of several that are high. */
	DDRB = 3;
	PORTB = 3;
	asm volatile("nop\n sbi 0x03, 0\n nop");
	result[30] = PORTB;
	DDRB = 0;
	PORTB = 0;
}

static void eeprom(void)
{
	while (EECR & (1 << EEPE)) ;
	EEAR = 5;
	EEDR = 0x5A;
	TCCR1B = 0; TCNT1 = 0; TCCR1B = 3;      /* 4 us per tick */
	EECR = 1 << EEMPE;
	EECR |= 1 << EEPE;
	while (EECR & (1 << EEPE)) ;
	result[31] = TCNT1 * 4;
	TCCR1B = 1;
	EEDR = 0;
	EECR |= 1 << EERE;
	result[32] = EEDR;
}

static void usart(void)
{
	uint16_t start, first, second;
	UBRR0 = 16;
	UCSR0A = (1 << U2X0) | (1 << TXC0);
	UCSR0B = 1 << TXEN0;
	start = TCNT1;
	UDR0 = 'a';
	while (!(UCSR0A & (1 << UDRE0))) ;
	result[33] = TCNT1 - start;
	UDR0 = 'b';
	while (!(UCSR0A & (1 << UDRE0))) ;
	first = TCNT1;
	UDR0 = 'c';
	while (!(UCSR0A & (1 << UDRE0))) ;
	second = TCNT1;
	result[34] = second - first;
	while (!(UCSR0A & (1 << TXC0))) ;
	UCSR0A = (1 << U2X0) | (1 << TXC0);
	start = TCNT1;
	UDR0 = 'd';
	while (!(UCSR0A & (1 << UDRE0))) ;
	UDR0 = 'e';
	while (!(UCSR0A & (1 << TXC0))) ;
	result[35] = TCNT1 - start;
	UCSR0A = (1 << U2X0) | (1 << TXC0);
	result[36] = (UCSR0A >> UDRE0) & 1;
	result[37] = (UCSR0A >> TXC0) & 1;
	UCSR0B = 0;
}

static uint16_t conversion(void)
{
	uint16_t start = TCNT1;
	ADCSRA |= 1 << ADSC;
	while (ADCSRA & (1 << ADSC)) ;
	return TCNT1 - start;
}

static void adc(void)
{
	ADMUX = 0x40;
	ADCSRA = (1 << ADEN) | 7;
	result[38] = conversion();
	result[39] = conversion();
	ADCSRA = (1 << ADEN) | 4;
	result[40] = conversion();
	ADCSRA |= 1 << ADIF;
	result[41] = ADCSRA & (1 << ADIF);
	/* Free running at /128: period of ADIF. */
	ADCSRB = 0;
	ADCSRA = (1 << ADEN) | (1 << ADATE) | (1 << ADSC) | 7;
	uint16_t last = 0;
	for (uint8_t i = 0; i < 3; i++) {
		while (!(ADCSRA & (1 << ADIF))) ;
		result[42] = TCNT1 - last;
		last = TCNT1;
		ADCSRA |= 1 << ADIF;
	}
	ADCSRA = 0;
	/* Triggered by Timer0 compare A: CTC, /64, OCR0A = 61. */
	TCCR0A = 2;
	OCR0A = 61;
	TCNT0 = 0;
	TIFR0 = 7;
	ADCSRB = 3;
	ADCSRA = (1 << ADEN) | (1 << ADATE) | 7;
	TCCR0B = 3;
	for (uint8_t i = 0; i < 4; i++) {
		while (!(ADCSRA & (1 << ADIF))) ;
		result[43] = TCNT1 - last;
		last = TCNT1;
		ADCSRA |= 1 << ADIF;
		TIFR0 = 1 << OCF0A;
	}
	TCCR0B = 0;
	ADCSRA = 0;
}

int main(void)
{
	TCCR1B = 1;
	instructions();
	interrupts();
	wake();
	level();
	timers();
	pins();
	eeprom();
	usart();
	adc();
	cli();
	for (;;) ;
}
