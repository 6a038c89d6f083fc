/* Pure computation: CORDIC rotations in 32 bit and products in 64 bit. */
#include "rounds.h"

volatile int32_t result;
volatile uint64_t product;
static const int32_t angles[16] = {
	0x20000000, 0x12E4051E, 0x09FB385B, 0x051111D4, 0x028B0D43, 0x0145D7E1, 0x00A2F61E,
	0x00517C55, 0x0028BE53, 0x00145F2F, 0x000A2F98, 0x000517CC, 0x00028BE6, 0x000145F3,
	0x0000A2FA, 0x0000517D };

int main(void)
{
	uint64_t p = 88172645463325252ULL;
	int32_t start = 0;
	EACH_ROUND {
		int32_t x = 0x26DD3B6A, y = 0, z = start & 0x1FFFFFFF;
		for (uint8_t i = 0; i < 16; i++) {
			int32_t dx = x >> i, dy = y >> i;
			if (z >= 0) { x -= dy; y += dx; z -= angles[i]; }
			else { x += dy; y -= dx; z += angles[i]; }
		}
		p = p * 6364136223846793005ULL + (uint32_t)x;
		result = y;
		product = p;
		start += 12345;
	}
	END();
}
