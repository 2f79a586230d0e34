/* udp_loop [PORT [PRIORITY [FILE]]]: drive the robot behind UDP on this machine, and write each step to a file. */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include "dqc_loop.h"
#include "udp.h"

#define ROWS ((int64_t)(DQC_DURATION / DQC_PERIOD) + 20000)

static dqc_loop loop;

typedef struct {
  int socket;
  int64_t sent;
  dqc_state_datagram last;
} robot_link;

static int exchange(void *robot, const double *u, double *q, double *measured) {
  robot_link *link = robot;
  dqc_state_datagram state;
  int came = 0;
  while (recv(link->socket, &state, sizeof state, u ? MSG_DONTWAIT : 0) == (ssize_t)sizeof state) {
    link->last = state; /* the newest counts */
    came = 1;
    if (!u) break;
  }
  if (u) {
    dqc_command_datagram command = {++link->sent, {0}};
    memcpy(command.u, u, sizeof command.u);
    if (send(link->socket, &command, sizeof command, MSG_DONTWAIT) < 0) return 1;
  }
  memcpy(q, link->last.q, sizeof state.q);
  memcpy(measured, link->last.measured, sizeof state.measured);
  return !came;
}

int main(int count, char **words) {
  int port = count > 1 ? atoi(words[1]) : DQC_PORT, priority = count > 2 ? atoi(words[2]) : 0;
  struct sockaddr_in robot = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
  struct timeval patience = {5, 0};
  robot_link link = {socket(AF_INET, SOCK_DGRAM, 0), 0, {0, {0}, {0}}};
  robot.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  dqc_command_datagram hello = {0, {0}};
  setsockopt(link.socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  if (link.socket < 0 || connect(link.socket, (struct sockaddr *)&robot, sizeof robot)) return perror("udp_loop"), 1;
  if (send(link.socket, &hello, sizeof hello, 0) < 0) return perror("udp_loop"), 1;
  loop.capacity = ROWS;
  loop.rows = calloc((size_t)ROWS, sizeof *loop.rows);
  if (!loop.rows) return fprintf(stderr, "udp_loop: not enough memory\n"), 1;
  memset(loop.rows, 0, (size_t)ROWS * sizeof *loop.rows);
  mlockall(MCL_CURRENT | MCL_FUTURE);
  int status = dqc_loop_run(&loop, 0, exchange, &link, priority);
  printf("%s after %lld steps of %g s; %lld periods missed, %s\n", dqc_status_text(status), (long long)loop.written,
         DQC_PERIOD, (long long)loop.missed, loop.real_time ? "SCHED_FIFO" : "ordinary scheduling");
  FILE *file = count > 3 ? fopen(words[3], "wb") : 0;
  if (file) {
    fwrite(loop.rows, sizeof *loop.rows, (size_t)loop.written, file);
    fclose(file);
  }
  return status < 0;
}
