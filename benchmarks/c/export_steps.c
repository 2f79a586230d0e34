/* Step times of exported controllers and of CasADi's kinematics, in turns; calls of malloc meanwhile.
 *
 * Kinematics are asked at configurations drawn from ±2 rad: at a start with angles of 0 libm's sine has nothing to do.
 *
 * Compiled with -DWITH_CASADI if there is casadi.c, which has a function "kinematics" of q. malloc, calloc and realloc
 * are wrapped by the linker. */
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "dqc_controller.h"
#include "dqc_kernels.h"
#include "test_vector.h"

#define SPELL 40
#define SPELLS 2500 /* 100 000 steps */
#define ROUND 25    /* spells, of which the least counts: what a step takes by itself */

static long allocations = 0;
void *__real_malloc(size_t), *__real_calloc(size_t, size_t), *__real_realloc(void *, size_t);
void *__wrap_malloc(size_t size) { return allocations++, __real_malloc(size); }
void *__wrap_calloc(size_t count, size_t size) { return allocations++, __real_calloc(count, size); }
void *__wrap_realloc(void *old, size_t size) { return allocations++, __real_realloc(old, size); }

static dqc_controller controller;
static double ours[SPELLS], kinematics_time[SPELLS], theirs[SPELLS], row[8 + 14 * DQC_INPUTS], drawn[SPELL][DQC_COORDINATES];

static double now(void) {
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return 1e9 * (double)time.tv_sec + (double)time.tv_nsec;
}

static int compare(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

#ifdef WITH_CASADI
int kinematics(const double **arg, double **res, long long *iw, double *w, int mem);
int kinematics_work(long long *sz_arg, long long *sz_res, long long *sz_iw, long long *sz_w);
static const double *arg[64];
static double *res[64], work[1 << 16], pose[8], pose_jacobian[8 * DQC_INPUTS], twist_jacobian[6 * DQC_INPUTS];
static long long iwork[1 << 16];
#endif

/* Return the median over rounds of the least of their spells. */
static double floor_of(const double *spells) {
  static double least[SPELLS / ROUND];
  for (int k = 0; k < SPELLS / ROUND; k++) {
    least[k] = spells[k * ROUND];
    for (int i = 1; i < ROUND; i++)
      if (spells[k * ROUND + i] < least[k]) least[k] = spells[k * ROUND + i];
  }
  qsort(least, SPELLS / ROUND, sizeof *least, compare);
  return least[SPELLS / ROUND / 2];
}

int main(void) {
  double u[DQC_INPUTS];
  srand(20261122);
  for (int k = 0; k < SPELL; k++)
    for (int i = 0; i < DQC_COORDINATES; i++) drawn[k][i] = 4.0 * rand() / RAND_MAX - 2.0;
  for (int spell = 0; spell < SPELLS; spell++) {
    dqc_init(&controller, 0);
    double begin = now();
    for (int k = 0; k < SPELL; k++) dqc_step(&controller, vector[k] + 5, k * DQC_PERIOD, 0, u);
    ours[spell] = (now() - begin) / SPELL;
    int64_t result;
    void *raised;
    begin = now();
    for (int k = 0; k < SPELL; k++)
      dqc_kernel_full(&result, &raised, ROWS(controller.memory_, DQC_TABLE_ROWS, DQC_TABLE_COLUMNS), NUMBERS(drawn[k], DQC_COORDINATES),
                      NUMBERS(row, 8 + 14 * DQC_INPUTS));
    kinematics_time[spell] = (now() - begin) / SPELL;
#ifdef WITH_CASADI
    begin = now();
    for (int k = 0; k < SPELL; k++) {
      arg[0] = drawn[k];
      res[0] = pose, res[1] = pose_jacobian, res[2] = twist_jacobian;
      kinematics(arg, res, iwork, work, 0);
    }
    theirs[spell] = (now() - begin) / SPELL;
#endif
  }
  double step = floor_of(ours), full = floor_of(kinematics_time), peer = floor_of(theirs);
  qsort(ours, SPELLS, sizeof *ours, compare);
  printf("%g %g %g %g %ld %zu\n", step, ours[SPELLS / 2], full, peer, allocations, sizeof(dqc_controller));
  return 0;
}
