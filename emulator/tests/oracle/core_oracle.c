/* Executes programs on simavr's ATmega328P core, instruction by instruction, for the lockstep
 * tests. Requests come on stdin, the state after each instruction goes to stdout; all numbers
 * are little endian.
 *
 * request:  u32 word address, u32 word count, words; u32 pc (bytes), u16 sp, u8 sreg,
 *           32 registers, 2048 bytes of SRAM, u32 steps. The rest of flash is `rjmp .-2`.
 * response: per instruction u8 1, u32 pc, u64 cycles, u16 sp, u8 sreg, 32 registers;
 *           then u8 0 and 2048 bytes of SRAM. A crash of the simulator ends the list early.
 */
#include <simavr/sim_avr.h>
#include <simavr/sim_core.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { RAM_START = 0x100, RAM_BYTES = 0x800, FLASH_WORDS = 0x4000 };

static void quiet(avr_t *avr, const int level, const char *format, va_list list)
{
	(void)avr; (void)level; (void)format; (void)list;
}

static void need(void *into, size_t size)
{
	if (fread(into, 1, size, stdin) != size)
		exit(0);
}

static void put(const void *from, size_t size)
{
	fwrite(from, 1, size, stdout);
}

static void set_sreg(avr_t *avr, uint8_t value)
{
	for (int i = 0; i < 8; i++)
		avr->sreg[i] = value >> i & 1;
}

static uint8_t get_sreg(avr_t *avr)
{
	uint8_t value = 0;
	for (int i = 0; i < 8; i++)
		value |= avr->sreg[i] << i;
	return value;
}

static void load(avr_t *avr)
{
	uint32_t address, count, pc;
	uint16_t sp;
	uint8_t sreg;
	for (int i = 0; i < FLASH_WORDS; i++) {
		avr->flash[2 * i] = 0xFF;
		avr->flash[2 * i + 1] = 0xCF;
	}
	need(&address, 4);
	need(&count, 4);
	for (uint32_t i = 0; i < count; i++)
		need(avr->flash + 2 * ((address + i) % FLASH_WORDS), 2);
	need(&pc, 4);
	need(&sp, 2);
	need(&sreg, 1);
	need(avr->data, 32);
	need(avr->data + RAM_START, RAM_BYTES);
	avr->pc = pc;
	_avr_sp_set(avr, sp);
	set_sreg(avr, sreg);
	avr->cycle = 0;
	avr->state = cpu_Running;
}

static void step(avr_t *avr)
{
	avr->pc = avr_run_one(avr);
	uint8_t more = 1, sreg = get_sreg(avr);
	uint32_t pc = avr->pc;
	uint64_t cycle = avr->cycle;
	uint16_t sp = _avr_sp_get(avr);
	put(&more, 1);
	put(&pc, 4);
	put(&cycle, 8);
	put(&sp, 2);
	put(&sreg, 1);
	put(avr->data, 32);
}

int main(void)
{
	avr_global_logger_set(quiet);
	avr_t *avr = avr_make_mcu_by_name("atmega328p");
	if (!avr)
		return 1;
	avr_init(avr);
	avr->frequency = 16000000;
	avr->log = 0;
	for (;;) {
		uint32_t steps;
		uint8_t done = 0;
		avr_reset(avr);
		load(avr);
		need(&steps, 4);
		for (uint32_t i = 0; i < steps && avr->state == cpu_Running; i++)
			step(avr);
		put(&done, 1);
		put(avr->data + RAM_START, RAM_BYTES);
		fflush(stdout);
	}
}
