/* How a loop and a robot in another process of this machine reach each other: over UDP, or over shared memory. */
#ifndef DQC_LINK_H
#define DQC_LINK_H

#include "dqc_controller.h"

typedef struct {
  int64_t number; /* 0: only a greeting, to be answered with where the robot is; −1: a farewell */
  double u[DQC_INPUTS];
} dqc_command;

typedef struct {
  int64_t number; /* of the command that it follows */
  double q[DQC_COORDINATES], measured[DQC_COORDINATES];
} dqc_state;

/* Meet at a place: a port of this machine, or a name of shared memory like /robot. The robot comes first. Return 0, or
 * -1 with errno. */
int link_as_robot(const char *place);
int link_as_loop(const char *place);

/* What the loop does waits for nothing: send; take the newest state that came since, return whether there is one; or
 * only ask that. */
void link_send_command(const dqc_command *command);
int link_take_state(dqc_state *state);
int link_has_state(void);

/* What the robot does: await the next command for so many s at most, return whether it came; answer it. */
int link_await_command(dqc_command *command, int patience);
void link_send_state(const dqc_state *state);

/* The robot is the last to go. */
void link_leave(const char *place);

#endif
