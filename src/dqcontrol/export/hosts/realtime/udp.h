/* What loop and robot send each other over UDP, each in one datagram. */
#ifndef DQC_UDP_H
#define DQC_UDP_H

#include "dqc_controller.h"

#define DQC_PORT 50721

typedef struct {
  int64_t number;
  double u[DQC_INPUTS];
} dqc_command_datagram;

typedef struct {
  int64_t number; /* of the command that it follows */
  double q[DQC_COORDINATES], measured[DQC_COORDINATES];
} dqc_state_datagram;

#endif
