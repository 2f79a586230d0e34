/* udp_robot [PORT]: the plant of the spec behind UDP on this machine. It moves a period with each command, and ends a
 * second after the last one. */
#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>

#include "dqc_plant.h"
#include "udp.h"

static dqc_plant plant;

int main(int count, char **words) {
  int port = count > 1 ? atoi(words[1]) : DQC_PORT, ours = socket(AF_INET, SOCK_DGRAM, 0);
  struct sockaddr_in here = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)}, there;
  socklen_t size = sizeof there;
  struct timeval patience = {10, 0};
  dqc_command_datagram command;
  here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (ours < 0 || bind(ours, (struct sockaddr *)&here, sizeof here)) return perror("udp_robot"), 1;
  dqc_plant_init(&plant);
  printf("ready\n");
  fflush(stdout);
  setsockopt(ours, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  while (recvfrom(ours, &command, sizeof command, 0, (struct sockaddr *)&there, &size) == (ssize_t)sizeof command) {
    dqc_state_datagram state = {.number = command.number};
    if (command.number && dqc_plant_step(&plant, command.u, 0)) return 1;
    memcpy(state.q, plant.q, sizeof state.q);
    memcpy(state.measured, plant.measured, sizeof state.measured);
    sendto(ours, &state, sizeof state, 0, (struct sockaddr *)&there, size);
    patience.tv_sec = 1;
    setsockopt(ours, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  }
  return 0;
}
