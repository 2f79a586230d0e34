/* Check the library: every answer as Python gave it, and what is said of bad calls. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "dqc_controller.h"
#include "test_vector.h"

#define FARTHEST 1e-12 /* on another processor than that of the export */

static int failures = 0;
static dqc_controller controller, another;

static void expect(const char *what, int is, int wanted) {
  if (is == wanted) return;
  printf("%s: %d (%s), expected %d (%s)\n", what, is, dqc_status_text(is), wanted, dqc_status_text(wanted));
  failures++;
}

static double follow_vector(void) {
  double farthest = 0.0, u[DQC_INPUTS], others[DQC_INPUTS];
  for (int row = 0; row < VECTOR_ROWS; row++) {
    const double *call = vector[row], *wrench = call + 5 + DQC_COORDINATES, *answer = wrench + VECTOR_WRENCH;
    dqc_measured measured = {call[1] != 0.0 ? call + 5 : 0, call[3], call[4], 0, VECTOR_WRENCH ? wrench : 0};
    if (call[0] == 1.0) dqc_end(&controller), dqc_end(&another);
    if (call[0] == 2.0) dqc_stop(&controller), dqc_stop(&another);
    if (call[0] == 3.0) expect("reset", dqc_reset(&controller), DQC_OK), dqc_reset(&another);
    int status = dqc_step_measured(&controller, &measured, call[2], 0, u);
    expect("a second controller", dqc_step_measured(&another, &measured, call[2], 0, others), status);
    if (memcmp(u, others, sizeof u)) failures++, printf("row %d: a second controller answers otherwise\n", row);
    int differs = status != (int)answer[0] || controller.interventions != (uint32_t)answer[1];
    for (int i = 0; i < DQC_INPUTS; i++) {
      double away = fabs(u[i] - answer[2 + i]);
      if (!(away <= farthest)) farthest = away;
      differs |= VECTOR_IS_EXACT ? memcmp(&u[i], &answer[2 + i], sizeof u[i]) != 0 : !(away <= FARTHEST);
    }
    if (differs && failures++ < 5)
      printf("row %d: status %d, interventions %#x, u[0] %.17g; expected %d, %#x, %.17g\n", row, status,
             (unsigned)controller.interventions, u[0], (int)answer[0], (unsigned)answer[1], answer[2]);
  }
  return farthest;
}

static void try_bad_calls(void) {
  double u[DQC_INPUTS], q[DQC_COORDINATES], value;
  dqc_config config = dqc_default_config();
  memcpy(q, vector[0] + 5, sizeof q);
  expect("null controller", dqc_step(0, q, 0.0, 0, u), DQC_NULL_POINTER);
  expect("null command", dqc_step(&another, q, 0.0, 0, 0), DQC_NULL_POINTER);
  expect("not initialised", dqc_step(&another, q, 0.0, 0, u), DQC_NOT_INITIALISED);
  expect("null init", dqc_init(0, 0), DQC_NULL_POINTER);
  config.coordinates++;
  expect("another robot", dqc_init(&another, &config), DQC_WRONG_ROBOT);
  config = dqc_default_config();
  config.linear_speed = NAN;
  expect("speed not finite", dqc_init(&another, &config), DQC_VALUE_OUTSIDE);
  config = dqc_default_config();
  config.source = 7;
  expect("unknown source", dqc_init(&another, &config), DQC_WRONG_TARGET);
  expect("init", dqc_init(&another, 0), DQC_OK);
  expect("start without measurement", dqc_step(&another, 0, 0.0, 0, u), DQC_NULL_POINTER);
  q[0] = NAN;
  expect("start not finite", dqc_step(&another, q, 0.0, 0, u), DQC_NOT_FINITE);
  expect("no such parameter", dqc_set(&another, "nothing", 1.0), DQC_UNKNOWN_PARAMETER);
  expect("null name", dqc_get(&another, 0, &value), DQC_NULL_POINTER);
  for (int i = 0; i < DQC_PARAMETERS; i++) {
    const dqc_parameter *parameter = &dqc_parameters[i];
    expect(parameter->name, dqc_set(&another, parameter->name, parameter->most * 2.0 + 1.0), DQC_VALUE_OUTSIDE);
    expect(parameter->name, dqc_set(&another, parameter->name, NAN), DQC_VALUE_OUTSIDE);
    expect(parameter->name, dqc_set(&another, parameter->name, parameter->value), DQC_OK);
    expect(parameter->name, dqc_get(&another, parameter->name, &value), DQC_OK);
    if (value != parameter->value) failures++, printf("%s: not kept\n", parameter->name);
  }
}

int main(void) {
  if (strcmp(dqc_law_hash(), DQC_LAW_HASH)) failures++, printf("the header is of another library\n");
  try_bad_calls();
  expect("init", dqc_init(&controller, 0), DQC_OK);
  expect("init", dqc_init(&another, 0), DQC_OK);
  double farthest = follow_vector();
  printf("%s %s for %s: %d steps, largest difference to Python %g%s; %zu bytes a controller; %s\n", DQC_LAW, DQC_LAW_HASH,
         DQC_ROBOT, VECTOR_ROWS, farthest, VECTOR_IS_EXACT ? " (bits compared)" : "", sizeof(dqc_controller),
         failures ? "FAILED" : "passed");
  return failures != 0;
}
