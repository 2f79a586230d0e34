/* bare_loop PERIOD_NS STEPS PRIORITY: a loop that only sleeps until absolute deadlines; prints begins, s, one a line. */
#define _GNU_SOURCE
#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>

static long long now(void) {
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return time.tv_sec * 1000000000LL + time.tv_nsec;
}

int main(int count, char **words) {
  if (count != 4) return 2;
  long long period = atoll(words[1]), steps = atoll(words[2]);
  struct sched_param scheduling = {.sched_priority = atoi(words[3])};
  long long *begin = calloc((size_t)steps, sizeof *begin);
  for (long long k = 0; k < steps; k++) begin[k] = 1;
  mlockall(MCL_CURRENT | MCL_FUTURE);
  if (scheduling.sched_priority) pthread_setschedparam(pthread_self(), SCHED_FIFO, &scheduling);
  long long first = now() + period;
  for (long long k = 0; k < steps; k++) {
    long long deadline = first + k * period;
    struct timespec time = {deadline / 1000000000LL, deadline % 1000000000LL};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, 0)) continue;
    begin[k] = now() - first;
  }
  for (long long k = 0; k < steps; k++) printf("%.9f\n", 1e-9 * (double)begin[k]);
  return 0;
}
