#include "dqc_plant.h"

#include <string.h>

@PROTOTYPE@
extern const double dqc_plant_parameters[], dqc_plant_state[], dqc_plant_start[];

#define NUMBERS(data, count) 0, 0, (int64_t)(count), 8, (data), (int64_t)(count), 8

void dqc_plant_init(dqc_plant *plant) {
  memset(plant, 0, sizeof *plant);
  memcpy(plant->q, dqc_plant_start, sizeof plant->q);
  memcpy(plant->measured, dqc_plant_start, sizeof plant->measured);
  memcpy(plant->state_, dqc_plant_state, @STATE_SIZE@ * sizeof(double));
}

int dqc_plant_step(dqc_plant *plant, const double *u, const double *noise) {
  static const double quiet[DQC_PLANT_NOISE] = {0};
  int64_t result = 1;
  void *raised;
  dqc_kernel_plant(&result, &raised, NUMBERS(u, DQC_INPUTS), NUMBERS(dqc_plant_parameters, @PARAMETERS@),
                   NUMBERS(noise ? noise : quiet, DQC_PLANT_NOISE), NUMBERS(plant->state_, @STATE_SIZE@),
                   NUMBERS(plant->q, DQC_COORDINATES), NUMBERS(plant->measured, DQC_COORDINATES));
  return result != 0;
}
