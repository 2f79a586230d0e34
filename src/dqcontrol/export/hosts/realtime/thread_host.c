/* The loop in a thread, on the plant of the spec: what dqcontrol watches with run --real-time --compiled. */
#include <pthread.h>
#include <string.h>

#include "dqc_loop.h"
#include "dqc_plant.h"

static dqc_loop loop;
static dqc_plant plant;
static const double *noise;
static int64_t noise_rows, step;
static int priority, last_status, is_done;
static pthread_t thread;

static int move_plant(void *robot, const double *u, double *q, double *measured) {
  (void)robot;
  if (u) {
    if (dqc_plant_step(&plant, u, noise + (step % noise_rows) * DQC_PLANT_NOISE)) return 1;
    step++;
  }
  memcpy(q, plant.q, sizeof plant.q);
  memcpy(measured, plant.measured, sizeof plant.measured);
  return 0;
}

static void *run(void *argument) {
  (void)argument;
  last_status = dqc_loop_run(&loop, 0, move_plant, 0, priority);
  __atomic_store_n(&is_done, 1, __ATOMIC_RELEASE);
  return 0;
}

int host_start(dqc_row *rows, int64_t capacity, const double *drawn, int64_t drawn_rows, int chosen_priority) {
  memset(rows, 0, (size_t)capacity * sizeof *rows);
  loop.rows = rows;
  loop.capacity = capacity;
  loop.request = DQC_LOOP_GO;
  noise = drawn;
  noise_rows = drawn_rows;
  priority = chosen_priority;
  step = 0;
  is_done = 0;
  dqc_plant_init(&plant);
  return pthread_create(&thread, 0, run, 0);
}

int host_join(void) {
  pthread_join(thread, 0);
  return last_status;
}

int64_t host_written(void) { return dqc_loop_written(&loop); }
int64_t host_row_size(void) { return sizeof(dqc_row); }
void host_request(int request) { dqc_loop_request(&loop, request); }
int host_is_real_time(void) { return loop.real_time; }
int host_is_done(void) { return __atomic_load_n(&is_done, __ATOMIC_ACQUIRE); }
