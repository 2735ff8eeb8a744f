/* Acts by a header on a Cortex-M board of QEMU. Prints the self test's result, instructions per action, and how many
   instructions are counted in a loop of a million. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include HEADER

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define CALLS 200
#define SIZE(array) ((int)(sizeof(array) / sizeof(float)))

/* SysTick counts down in 24 bits at 25 MHz. With -icount shift=0 an instruction takes 1 ns, so a tick is 40 of them. */
#define SYSTICK ((volatile uint32_t*)0xE000E010)
#define INSTRUCTIONS(begin) (40.0 * (((begin) - SYSTICK[2]) & 0xFFFFFF))

extern uint32_t stack_top;
extern void _start(void); /* of the C library */

static void reset(void) {
  *(volatile uint32_t*)0xE000ED88 |= 0xFu << 20; /* enables the FPU */
  __asm volatile("dsb\nisb");
  _start();
}

__attribute__((section(".vectors"), used)) static void (*const vectors[7])(void) = {
    (void (*)(void))(&stack_top), reset, abort, abort, abort, abort, abort};

int main(void) {
  static float action[SIZE(JOIN(POLICY, _test_action)) / CASES];
  SYSTICK[1] = SYSTICK[2] = 0xFFFFFF;
  SYSTICK[0] = 5;
  uint32_t begin = SYSTICK[2];
  for (int i = 0; i < CALLS; ++i) {
    JOIN(POLICY, _act)(JOIN(POLICY, _test_observation) + i % CASES * (SIZE(JOIN(POLICY, _test_observation)) / CASES), action);
  }
  const double each = INSTRUCTIONS(begin) / CALLS;
  uint32_t left = 500000;
  begin = SYSTICK[2];
  __asm volatile("1: subs %0, %0, #1\nbne 1b" : "+r"(left) : : "cc");
  const double million = INSTRUCTIONS(begin);
  printf("%.9g %.9g %.9g\n", (double)JOIN(POLICY, _self_test)(), each, million);
  exit(0);
}
