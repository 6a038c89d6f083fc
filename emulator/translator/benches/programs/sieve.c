/* Pure computation: sieve of Eratosthenes and a linear congruential generator. */
#include "rounds.h"

volatile uint32_t result;
static uint8_t composite[1024];

int main(void)
{
	uint32_t lcg = 1, sum = 0;
	EACH_ROUND {
		for (uint16_t i = 0; i < 1024; i++)
			composite[i] = 0;
		for (uint16_t i = 2; i < 1024; i++) {
			if (composite[i])
				continue;
			sum += i;
			for (uint16_t j = i + i; j < 1024; j += i)
				composite[j] = 1;
		}
		for (uint16_t i = 0; i < 1000; i++) {
			lcg = lcg * 1664525UL + 1013904223UL;
			sum ^= lcg >> 16;
		}
		result = sum;
	}
	END();
}
