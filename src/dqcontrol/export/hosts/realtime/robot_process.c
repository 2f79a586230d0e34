/* udp_robot PORT, shared_robot NAME: the plant of the spec in a process of its own. It moves a period with each command,
 * and ends with a farewell, or a second after the last one. */
#include <stdio.h>
#include <string.h>

#include "dqc_plant.h"
#include "link.h"

static dqc_plant plant;

int main(int count, char **words) {
  dqc_command command;
  int patience = 10, failed = 0;
  if (count != 2) return fprintf(stderr, "usage: %s PLACE\n", words[0]), 2;
  if (link_as_robot(words[1])) return perror(words[0]), 1;
  dqc_plant_init(&plant);
  printf("ready\n");
  fflush(stdout);
  while (!failed && link_await_command(&command, patience) && command.number >= 0) {
    dqc_state state = {.number = command.number};
    failed = command.number && dqc_plant_step(&plant, command.u, 0);
    memcpy(state.q, plant.q, sizeof state.q);
    memcpy(state.measured, plant.measured, sizeof state.measured);
    link_send_state(&state);
    patience = 1;
  }
  link_leave(words[1]);
  return failed;
}
