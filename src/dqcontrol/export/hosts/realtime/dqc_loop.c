#define _GNU_SOURCE
#include "dqc_loop.h"

#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <string.h>
#include <time.h>

#define BILLION 1000000000LL

static int64_t now(void) {
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return time.tv_sec * BILLION + time.tv_nsec;
}

static void sleep_until(int64_t deadline) {
  struct timespec time = {deadline / BILLION, deadline % BILLION};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, 0)) continue;
}

int64_t dqc_loop_written(const dqc_watch *watch) { return __atomic_load_n(&watch->written, __ATOMIC_ACQUIRE); }

void dqc_loop_request(dqc_watch *watch, int request) { __atomic_store_n(&watch->request, request, __ATOMIC_RELEASE); }

static void obey(dqc_loop *loop, int *done) {
  int request = (int)__atomic_load_n(&loop->watch->request, __ATOMIC_ACQUIRE);
  if (request == *done) return;
  *done = request;
  if (request == DQC_LOOP_END) dqc_end(&loop->controller);
  if (request == DQC_LOOP_STOP) dqc_stop(&loop->controller);
}

/* Stop once who watched has not been heard of for too long. */
static void miss_watcher(dqc_loop *loop, int64_t now, int64_t *heartbeat, int64_t *heard) {
  int64_t beat = __atomic_load_n(&loop->watch->heartbeat, __ATOMIC_ACQUIRE);
  if (beat != *heartbeat || !beat) *heartbeat = beat, *heard = now;
  if (1e-9 * (double)(now - *heard) > DQC_LOOP_PATIENCE) dqc_loop_request(loop->watch, DQC_LOOP_STOP);
}

static int end(dqc_watch *watch, int status) {
  watch->status = status;
  __atomic_store_n(&watch->is_done, 1, __ATOMIC_RELEASE);
  return status;
}

int dqc_loop_run(dqc_loop *loop, const dqc_config *config, const dqc_robot *robot, int priority) {
  const int64_t period = llround(1e9 * DQC_PERIOD);
  struct sched_param scheduling = {.sched_priority = priority};
  double u[DQC_INPUTS], q[DQC_COORDINATES], measured[DQC_COORDINATES];
  dqc_watch *watch = loop->watch;
  int obeyed = DQC_LOOP_GO, status = dqc_init(&loop->controller, config);
  if (status < 0) return end(watch, status);
  watch->written = watch->missed = watch->late = watch->is_done = 0;
  watch->real_time = priority > 0 && !pthread_setschedparam(pthread_self(), SCHED_FIFO, &scheduling);
  memset(q, 0, sizeof q);
  memset(measured, 0, sizeof measured);
  int64_t first = now() + period, deadline = first, before = first, slot = 0, heartbeat = watch->heartbeat, heard = first;
  for (int64_t k = 0; loop->capacity > 0; k++) {
    int64_t ready = now(), is_late = ready > deadline;
    if (is_late) { /* what was missed is left out: no burst of steps makes up for it */
      int64_t missed = (ready - deadline + period - 1) / period;
      watch->late++;
      watch->missed += missed;
      slot += missed;
      deadline += missed * period;
    }
    sleep_until(deadline);
    int64_t begin = now();
    miss_watcher(loop, begin, &heartbeat, &heard);
    obey(loop, &obeyed);
    if (k == loop->capacity) dqc_end(&loop->controller);
    int came = robot->measure(robot->robot, q, measured);
    dqc_measured input = {came ? measured : 0, 0.0, k ? 1e-9 * (double)(begin - before) : 0.0, 0, 0};
    int64_t asked = now();
    status = dqc_step_measured(&loop->controller, &input, (double)slot * DQC_PERIOD, 0, u);
    int64_t answered = now();
    robot->command(robot->robot, u);
    dqc_row *row = &loop->rows[k < loop->capacity ? k : loop->capacity - 1];
    row->time = (double)slot * DQC_PERIOD;
    row->begin = 1e-9 * (double)(begin - first);
    row->computation = 1e-9 * (double)(answered - asked);
    row->idle = 1e-9 * (double)(begin - ready);
    row->late = (double)is_late;
    memcpy(row->sample, loop->controller.sample, sizeof row->sample);
    memcpy(row->q, q, sizeof q);
    memcpy(row->measured, measured, sizeof measured);
    memcpy(row->command, u, sizeof u);
    row->interventions = loop->controller.interventions;
    row->status = status;
    __atomic_store_n(&watch->written, k < loop->capacity ? k + 1 : loop->capacity, __ATOMIC_RELEASE);
    before = begin;
    deadline += period;
    slot++;
    if (status == DQC_ENDED || status == DQC_STOPPED || (status < 0 && k == 0)) break;
  }
  return end(watch, status);
}
