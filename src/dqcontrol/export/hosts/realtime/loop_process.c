/* udp_loop PORT [PRIORITY [FILE]], shared_loop NAME [PRIORITY [FILE]]: drive the robot of another process.
 *
 * FILE: a dqc_watch, then a dqc_row each step; others may map it and look on, or write a request. In /dev/shm no disk
 * is waited for. With a heartbeat in it whoever started the loop watches it: where that one dies, the robot is braked, and
 * so it is at SIGINT, SIGTERM and SIGHUP. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "dqc_loop.h"
#include "link.h"

#define ROWS ((int64_t)(DQC_DURATION / DQC_PERIOD) + 20000)
#define PATIENCE 5000 /* ms for the robot to answer the greeting */

static dqc_loop loop;
static dqc_state last;

static int measure(void *robot, double *q, double *measured) {
  (void)robot;
  int came = link_take_state(&last);
  memcpy(q, last.q, sizeof last.q);
  memcpy(measured, last.measured, sizeof last.measured);
  return came;
}

static void command(void *robot, const double *u) {
  static int64_t sent = 0;
  (void)robot;
  dqc_command next = {++sent, {0}};
  memcpy(next.u, u, sizeof next.u);
  link_send_command(&next);
}

/* Greet the robot until it answers; return whether it did. Its answer is left for the first step. */
static int greet(void) {
  const dqc_command greeting = {0, {0}};
  const struct timespec pause = {0, 1000000};
  for (int i = 0; i < PATIENCE; i++) {
    if (i % 100 == 0) link_send_command(&greeting);
    if (link_has_state()) return 1;
    nanosleep(&pause, 0);
  }
  return 0;
}

/* Room for steps: in a file that is as long as its maker wants, or in memory. */
static int make_room(const char *path) {
  struct stat about;
  size_t size = sizeof(dqc_watch) + (size_t)ROWS * sizeof(dqc_row);
  int file = path ? open(path, O_CREAT | O_RDWR, 0644) : -1;
  if (path && (file < 0 || fstat(file, &about))) return -1;
  if (path && (size_t)about.st_size > sizeof(dqc_watch)) size = (size_t)about.st_size;
  if (path && ftruncate(file, (off_t)size)) return -1;
  char *room = mmap(0, size, PROT_READ | PROT_WRITE, path ? MAP_SHARED : MAP_PRIVATE | MAP_ANONYMOUS, file, 0);
  if (room == MAP_FAILED) return -1;
  int64_t heartbeat = ((dqc_watch *)room)->heartbeat;
  memset(room, 0, size);
  loop.watch = (dqc_watch *)room;
  loop.watch->heartbeat = heartbeat;
  loop.rows = (dqc_row *)(room + sizeof(dqc_watch));
  loop.capacity = (int64_t)((size - sizeof(dqc_watch)) / sizeof(dqc_row));
  return 0;
}

static void stop(int number) {
  (void)number;
  dqc_loop_request(loop.watch, DQC_LOOP_STOP);
}

/* Brake for signals, among them the death of who watches. One that died before is missed by its heartbeat. */
static void brake_for_signals(void) {
  const struct sigaction braking = {.sa_handler = stop, .sa_flags = SA_RESTART};
  sigaction(SIGINT, &braking, 0);
  sigaction(SIGTERM, &braking, 0);
  sigaction(SIGHUP, &braking, 0);
  if (loop.watch->heartbeat) prctl(PR_SET_PDEATHSIG, SIGTERM);
}

int main(int count, char **words) {
  if (count < 2) return fprintf(stderr, "usage: %s PLACE [PRIORITY [FILE]]\n", words[0]), 2;
  if (make_room(count > 3 ? words[3] : 0) || link_as_loop(words[1])) return perror(words[0]), 1;
  mlockall(MCL_CURRENT | MCL_FUTURE);
  brake_for_signals();
  if (!greet()) return fprintf(stderr, "%s: no robot answers at %s\n", words[0], words[1]), 1;
  const dqc_robot robot = {0, measure, command};
  int status = dqc_loop_run(&loop, 0, &robot, count > 2 ? atoi(words[2]) : 0);
  const dqc_command farewell = {-1, {0}};
  link_send_command(&farewell);
  printf("%s after %lld steps of %g s; %lld periods missed, %s\n", dqc_status_text(status), (long long)loop.watch->written,
         DQC_PERIOD, (long long)loop.watch->missed, loop.watch->real_time ? "SCHED_FIFO" : "ordinary scheduling");
  return status < 0;
}
