/* A tour through libgcc, libm and libc: what real firmware is made of. Ends in `exit`. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

char text[200];
uint64_t product;
int32_t quotient;
float sum;
uint8_t sieve[200];
int16_t numbers[24];

static int order(const void *a, const void *b)
{
	return *(const int16_t *)a - *(const int16_t *)b;
}

int main(void)
{
	product = 1;
	for (uint8_t i = 1; i < 20; i++)
		product = product * 6364136223846793005ULL + i;
	quotient = (int32_t)(product >> 20) / 12345;
	for (uint8_t i = 1; i < 12; i++)
		sum += sinf(i * 0.3f) * sqrtf(i) + atan2f(i, 3.0f) - expf(-i);
	for (uint8_t i = 2; i < 200; i++)
		if (!sieve[i])
			for (uint16_t j = i * 2; j < 200; j += i)
				sieve[j] = 1;
	for (uint8_t i = 0; i < 24; i++)
		numbers[i] = (int16_t)rand();
	qsort(numbers, 24, 2, order);
	sprintf(text, "%ld %s %d %lu", (long)quotient, "text", numbers[3], (unsigned long)product);
	strcat(text, " end");
	return strlen(text);
}
