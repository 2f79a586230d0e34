/* The loop in a thread, on the plant of the spec: what dqcontrol watches with run --real-time --compiled. */
#include <pthread.h>
#include <string.h>

#include "dqc_loop.h"
#include "dqc_plant.h"

static dqc_loop loop;
static dqc_watch watch;
static dqc_plant plant;
static const double *noise;
static int64_t noise_rows, step;
static int priority, has_failed;
static pthread_t thread;

static int measure(void *robot, double *q, double *measured) {
  (void)robot;
  memcpy(q, plant.q, sizeof plant.q);
  memcpy(measured, plant.measured, sizeof plant.measured);
  return !has_failed;
}

static void command(void *robot, const double *u) {
  (void)robot;
  has_failed |= dqc_plant_step(&plant, u, noise + (step % noise_rows) * DQC_PLANT_NOISE);
  step++;
}

static void *run(void *argument) {
  (void)argument;
  const dqc_robot robot = {0, measure, command};
  dqc_loop_run(&loop, 0, &robot, priority);
  return 0;
}

int host_start(dqc_row *rows, int64_t capacity, const double *drawn, int64_t drawn_rows, int chosen_priority) {
  memset(rows, 0, (size_t)capacity * sizeof *rows);
  loop.rows = rows;
  loop.capacity = capacity;
  loop.watch = &watch;
  memset(&watch, 0, sizeof watch);
  noise = drawn;
  noise_rows = drawn_rows;
  priority = chosen_priority;
  step = has_failed = 0;
  dqc_plant_init(&plant);
  return pthread_create(&thread, 0, run, 0);
}

int host_join(void) {
  pthread_join(thread, 0);
  return (int)watch.status;
}

int64_t host_written(void) { return dqc_loop_written(&watch); }
void host_request(int request) { dqc_loop_request(&watch, request); }
int host_is_done(void) { return (int)__atomic_load_n(&watch.is_done, __ATOMIC_ACQUIRE); }
