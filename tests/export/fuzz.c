/* fuzz STEPS SEED: whatever comes in, what leaves keeps the supervisor's limits, and nothing is NaN. Of a base that drives,
 * VELOCITY and ACCELERATION hold the limits of all inputs and LEVER what turning adds to its fastest rim (m): it moves as
 * the plant of the spec, and its middle stays before x = WALL. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dqc_controller.h"
#include "test_vector.h"
#ifdef LEVER
#include "dqc_plant.h"
static dqc_plant plant;
#endif

/* Where the robot is after a command, or at its start for none. */
static void move(double *q, const double *u) {
#ifdef LEVER
  if (u) dqc_plant_step(&plant, u, 0);
  else dqc_plant_init(&plant);
  memcpy(q, plant.q, DQC_COORDINATES * sizeof *q);
#else
  if (!u) memcpy(q, vector[0] + 5, DQC_COORDINATES * sizeof *q);
  for (int i = 0; u && i < DQC_INPUTS; i++) q[i] += DQC_PERIOD * u[i];
#endif
}

static uint64_t state;

static double uniform(void) {
  state ^= state << 13, state ^= state >> 7, state ^= state << 17;
  return (double)(state >> 11) / 9007199254740992.0;
}

static int chance(double share) { return uniform() < share; }

static double odd(void) {
  static const double odds[] = {NAN, INFINITY, -INFINITY, 1e308, -1e308, 0.0, -0.0, 1e-320, 1e9, -3.0};
  return odds[(int)(uniform() * 10)];
}

static double bound(const char *kind, int i) {
#ifdef LEVER
  static const double velocity[] = VELOCITY, acceleration[] = ACCELERATION;
  return strstr(kind, "velocity") ? velocity[i] : acceleration[i];
#else
  for (const dqc_parameter *p = dqc_parameters; p->name; p++)
    if (strstr(p->name, kind) && i-- == 0) return p->value;
  exit(2);
#endif
}

/* What else is wrong with a command u to a base that is at q. */
static int breaks_base(const double *q, const double *u) {
#ifdef LEVER
  return !(q[0] <= WALL) || !(fabs(u[0]) + LEVER * fabs(u[1]) <= bound("velocity", 0) * (1 + 1e-9));
#else
  (void)q, (void)u;
  return 0;
#endif
}

int main(int count, char **words) {
  long steps = count > 1 ? atol(words[1]) : 1000, stopped = 0, starts = 0, bad = 0;
  double nearest = -INFINITY;
  static dqc_controller controller;
  double q[DQC_COORDINATES], u[DQC_INPUTS], last[DQC_INPUTS] = {0}, time = 0.0, effort[DQC_INPUTS], wrench[6];
  double velocity[DQC_INPUTS], acceleration[DQC_INPUTS];
  state = count > 2 ? strtoull(words[2], 0, 10) : 1;
  printf("seed %llu\n", (unsigned long long)state);
  for (int i = 0; i < DQC_INPUTS; i++) velocity[i] = bound("supervisor.velocity", i), acceleration[i] = bound("supervisor.acceleration", i);
  dqc_init(&controller, 0);
  move(q, 0);
  for (long k = 0; k < steps; k++) {
    dqc_measured measured = {q, chance(0.02) ? odd() : 0.0, chance(0.02) ? odd() : 0.0, 0, 0};
    double sent[DQC_COORDINATES], now;
    time += DQC_PERIOD * (chance(0.01) ? 10 * uniform() : 1.0);
    now = chance(0.01) ? odd() : chance(0.01) ? time - uniform() : time;
    memcpy(sent, q, sizeof q);
    if (chance(0.03)) sent[(int)(uniform() * DQC_COORDINATES)] = chance(0.5) ? odd() : 4.0 * uniform() - 2.0;
    measured.q = chance(0.01) ? 0 : sent;
    for (int i = 0; i < DQC_INPUTS; i++) effort[i] = chance(0.01) ? odd() : uniform();
    for (int i = 0; i < 6; i++) wrench[i] = chance(0.01) ? odd() : uniform();
    if (chance(0.5)) measured.effort = effort;
    if (chance(0.5)) measured.wrench = wrench;
    if (chance(0.001)) dqc_stop(&controller);
    if (chance(0.0005)) dqc_end(&controller);
    int status = dqc_step_measured(&controller, &measured, now, 0, u);
    int restarted = 0;
    for (int i = 0; i < DQC_INPUTS; i++) {
      const double *p = dqc_position(&controller);
      int wrong = !(fabs(u[i]) <= velocity[i] * (1 + 1e-9)) || !isfinite(p[i]);
      wrong |= status >= 0 && fabs(u[i] - last[i]) > acceleration[i] * DQC_PERIOD * (1 + 1e-6) + 1e-12;
      if (wrong && bad++ < 5) printf("step %ld: status %d, u[%d] %g after %g\n", k, status, i, u[i], last[i]);
    }
    memcpy(last, u, sizeof u);
    if (status == DQC_STOPPED || status == DQC_ENDED || status < 0) {
      stopped += status == DQC_STOPPED;
      if (!dqc_reset(&controller) && ++starts) {
        if (chance(0.5)) move(q, 0);
        memset(last, 0, sizeof last);
        restarted = 1;
      }
    }
    if (!restarted) move(q, u);
    if (breaks_base(q, u) && bad++ < 5) printf("step %ld: base at x = %g, v %g, omega %g\n", k, q[0], u[0], u[1]);
    nearest = fmax(nearest, q[0]);
  }
  printf("largest x %g\n", nearest);
  printf("%ld steps, %ld stops, %ld starts, %ld outside the limits or not finite\n", steps, stopped, starts, bad);
  return bad != 0;
}
