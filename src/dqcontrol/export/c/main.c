/* An example: the controller drives the plant of its spec, or ideal joints, as fast as it can.
 *
 * On a robot the plant is the robot: read q, call dqc_step once a period with the robot's time, send u.
 */
#include <stdio.h>

#include "dqc_controller.h"
#ifdef HAS_PLANT
#include "dqc_plant.h"
#endif
#include "test_vector.h"

static dqc_controller controller; /* static memory: nothing is allocated */

int main(void) {
  double u[DQC_INPUTS], q[DQC_COORDINATES];
  int status = dqc_init(&controller, 0);
#ifdef HAS_PLANT
  static dqc_plant plant;
  dqc_plant_init(&plant);
  for (int i = 0; i < DQC_COORDINATES; i++) q[i] = plant.measured[i];
#else
  for (int i = 0; i < DQC_COORDINATES; i++) q[i] = vector[0][5 + i];
#endif
  long every = (long)(0.5 / DQC_PERIOD) > 0 ? (long)(0.5 / DQC_PERIOD) : 1;
  for (long k = 0; status >= 0 && status != DQC_ENDED; k++) {
    dqc_measured measured = {q, 0.0, 0.0, 0, 0};
#ifdef HAS_PLANT
    if (DQC_PLANT_WRENCH >= 0) measured.wrench = plant.state_ + (DQC_PLANT_WRENCH < 0 ? 0 : DQC_PLANT_WRENCH);
#endif
    status = dqc_step_measured(&controller, &measured, k * DQC_PERIOD, 0, u);
    if (k % every == 0 || status) {
      printf("%8.3f s  %-16s  q =", k * DQC_PERIOD, dqc_status_text(status));
      for (int i = 0; i < DQC_COORDINATES; i++) printf(" %8.4f", q[i]);
      printf("\n");
    }
    if (status == DQC_STOPPED) break;
#ifdef HAS_PLANT
    if (dqc_plant_step(&plant, u, 0)) return 1;
    for (int i = 0; i < DQC_COORDINATES; i++) q[i] = plant.measured[i];
#elif DQC_COORDINATES == DQC_INPUTS
    for (int i = 0; i < DQC_INPUTS; i++) q[i] += DQC_PERIOD * u[i];
#else
    break; /* a mobile base: how it moves is up to its plant */
#endif
  }
  return status < 0;
}
