/* The same programs on simavr: `simavr_run FLASH.bin CYCLES` prints the host seconds of the run.
 * Its pacing to real time is switched off. */
#include <simavr/sim_avr.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static void quiet(avr_t *avr, const int level, const char *format, va_list list)
{
	(void)avr; (void)level; (void)format; (void)list;
}

static void no_pacing(avr_t *avr, avr_cycle_count_t cycles)
{
	(void)avr; (void)cycles;
}

static double now(void)
{
	struct timespec t;
	clock_gettime(CLOCK_MONOTONIC, &t);
	return t.tv_sec + t.tv_nsec * 1e-9;
}

int main(int argc, char **argv)
{
	if (argc != 3)
		return 2;
	avr_global_logger_set(quiet);
	avr_t *avr = avr_make_mcu_by_name("atmega328p");
	avr_init(avr);
	avr->frequency = 16000000;
	avr->sleep = no_pacing;
	FILE *file = fopen(argv[1], "rb");
	if (!file)
		return 2;
	size_t size = fread(avr->flash, 1, 0x8000, file);
	fclose(file);
	avr->codeend = size;
	unsigned long long limit = strtoull(argv[2], NULL, 10);
	double begin = now();
	while (avr->cycle < limit) {
		int state = avr_run(avr);
		if (state == cpu_Done || state == cpu_Crashed)
			break;
	}
	printf("%.6f %llu\n", now() - begin, (unsigned long long)avr->cycle);
	return 0;
}
