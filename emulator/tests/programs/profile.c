/* Calls of every kind, each a known number of times. */
#include <alloca.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <setjmp.h>
#include <stdint.h>

#define NEVER_INLINE __attribute__((noinline, noclone))

volatile uint16_t ticks;
volatile int sink;
static jmp_buf back;

ISR(TIMER1_COMPA_vect) { ticks++; }

/* Inlined wherever it is used. */
static inline int twice(int x) { return x * 2 + GPIOR1; }

NEVER_INLINE int leaf(int x) { return twice(x) + 1; }

/* Removed by the linker; its debug information stays, at address 0. */
int dead(int x)
{
    for (int i = 0; i < x; i++)
        sink += twice(i) * leaf(i);
    return sink;
}

/* Ends in a jump to leaf. */
NEVER_INLINE int tail(int x)
{
    sink = x;
    return leaf(x + 1);
}

NEVER_INLINE int factorial(int n)
{
    if (n < 2)
        return 1;
    int rest = factorial(n - 1);
    sink = rest;
    return n * rest;
}

NEVER_INLINE void thrower(int depth)
{
    volatile char room[20];
    room[depth & 15] = depth;
    if (depth == 0)
        longjmp(back, 1);
    thrower(depth - 1);
    sink = room[3];
}

NEVER_INLINE int local(unsigned n)
{
    char *room = alloca(n);
    for (unsigned i = 0; i < n; i++)
        room[i] = leaf(i);
    return room[n - 1];
}

/* Many saved registers: shared prologue and epilogue with -mcall-prologues. */
NEVER_INLINE long wide(long a, long b)
{
    long c = a * b, d = a - b, e = leaf(a);
    for (char i = 0; i < 3; i++) {
        c += leaf(c) * d;
        d ^= e * c;
        e -= a + leaf(b);
    }
    return c + d + e;
}

int main(void)
{
    OCR1A = 1499;
    TCCR1B = _BV(WGM12) | _BV(CS10);
    TIMSK1 = _BV(OCIE1A);
    sei();
    for (int i = 0; i < 10; i++)
        sink = tail(i);
    sink = factorial(6);
    for (char i = 0; i < 4; i++)
        if (setjmp(back) == 0)
            thrower(5);
    sink = local(12);
    sink = wide(3, 4);
    set_sleep_mode(SLEEP_MODE_IDLE);
    for (char i = 0; i < 20; i++)
        sleep_mode();
    cli();
    return 0;
}
