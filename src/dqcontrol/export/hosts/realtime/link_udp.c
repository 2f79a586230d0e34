/* Each command and each state is a datagram on the loopback; place: a port. */
#include <arpa/inet.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <time.h>

#include "link.h"

static int ours = -1;
static struct sockaddr_in there;

static int at(const char *place, int (*meet)(int, const struct sockaddr *, socklen_t)) {
  struct sockaddr_in here = {.sin_family = AF_INET, .sin_port = htons((uint16_t)atoi(place))};
  here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ours = socket(AF_INET, SOCK_DGRAM, 0);
  return ours < 0 ? -1 : meet(ours, (struct sockaddr *)&here, sizeof here);
}

int link_as_robot(const char *place) { return at(place, bind); }
int link_as_loop(const char *place) { return at(place, connect); }

void link_send_command(const dqc_command *command) { send(ours, command, sizeof *command, MSG_DONTWAIT); }

int link_has_state(void) {
  dqc_state next;
  return recv(ours, &next, sizeof next, MSG_DONTWAIT | MSG_PEEK) == (ssize_t)sizeof next;
}

int link_take_state(dqc_state *state) {
  int came = 0;
  dqc_state newest;
  while (recv(ours, &newest, sizeof newest, MSG_DONTWAIT) == (ssize_t)sizeof newest) *state = newest, came = 1;
  return came;
}

int link_await_command(dqc_command *command, int patience) {
  char came[sizeof *command + 1]; /* one byte more, to see what is too long */
  struct sockaddr_in from;
  struct timespec begin, now;
  const struct timeval most = {patience, 0};
  setsockopt(ours, SOL_SOCKET, SO_RCVTIMEO, &most, sizeof most);
  clock_gettime(CLOCK_MONOTONIC, &begin);
  do { /* what is no command is not for us */
    socklen_t size = sizeof from;
    if (recvfrom(ours, came, sizeof came, 0, (struct sockaddr *)&from, &size) == (ssize_t)sizeof *command) {
      memcpy(command, came, sizeof *command);
      there = from;
      return 1;
    }
    clock_gettime(CLOCK_MONOTONIC, &now);
  } while (now.tv_sec - begin.tv_sec < patience);
  return 0;
}

void link_send_state(const dqc_state *state) {
  sendto(ours, state, sizeof *state, 0, (struct sockaddr *)&there, sizeof there);
}

void link_leave(const char *place) { (void)place; }
