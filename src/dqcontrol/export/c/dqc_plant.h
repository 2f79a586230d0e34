/* The plant of the spec (@PLANT@), to try the controller on: joints as they move, and what encoders say of them. */
#ifndef DQC_PLANT_H
#define DQC_PLANT_H

#include "dqc_controller.h"

#ifdef __cplusplus
extern "C" {
#endif

#define DQC_PLANT_NOISE @NOISE@ /* random numbers of a step, of variance 1 */
#define DQC_PLANT_WRENCH @WRENCH@ /* where its state has force and torque at the hand; -1: it measures none */

typedef struct {
  double q[DQC_COORDINATES];        /* rad or m */
  double measured[DQC_COORDINATES]; /* what encoders say */
  double state_[@STATE@];
} dqc_plant;

/* Put it where the spec starts, at rest. */
void dqc_plant_init(dqc_plant *plant);

/* Move for a period; noise: DQC_PLANT_NOISE numbers, null for none. Return 0, or 1 if it produced NaN or infinity. */
int dqc_plant_step(dqc_plant *plant, const double *u, const double *noise);

#ifdef __cplusplus
}
#endif
#endif
