/* How long a step takes, and how much stack it needs, on this machine. */
#define _POSIX_C_SOURCE 200809L
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "dqc_controller.h"
#include "test_vector.h"

#define STEPS 100000
#define STACK (1 << 20)
#define PAINT 0xA5

static dqc_controller controller;
static double took[STEPS]; /* ns */
static unsigned char stack[STACK] __attribute__((aligned(4096)));

static double now(void) {
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return 1e9 * (double)time.tv_sec + (double)time.tv_nsec;
}

static int compare(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

/* Walk through the test vector again and again, without its requests. */
static void *walk(void *argument) {
  double u[DQC_INPUTS];
  long steps = *(long *)argument, k = 0;
  while (k < steps) {
    dqc_init(&controller, 0);
    for (int row = 0; row < 40 && row < VECTOR_ROWS && k < steps; row++, k++) {
      double before = now();
      dqc_step(&controller, vector[row] + 5, row * DQC_PERIOD, 0, u);
      took[k] = now() - before;
    }
  }
  return 0;
}

int main(void) {
  long few = 200, all = STEPS;
  pthread_t thread;
  pthread_attr_t attributes;
  memset(stack, PAINT, sizeof stack);
  pthread_attr_init(&attributes);
  pthread_attr_setstack(&attributes, stack, sizeof stack);
  if (pthread_create(&thread, &attributes, walk, &few)) return 1;
  pthread_join(thread, 0);
  size_t untouched = 0;
  while (untouched < sizeof stack && stack[untouched] == PAINT) untouched++;
  walk(&all);
  double clock = now();
  for (int i = 0; i < 1000; i++) now();
  clock = (now() - clock) / 1000;
  qsort(took, STEPS, sizeof *took, compare);
  printf("%.0f ns a step (median; 99.9 %%: %.0f ns), less about %.0f ns of reading the clock; stack with its thread: at most %zu bytes\n",
         took[STEPS / 2], took[STEPS / 1000 * 999], clock, sizeof stack - untouched);
  return 0;
}
