/* Command and state lie in shared memory; place: its name, like /robot. Each has one writer, and a count that is odd
 * while it is written: who reads meanwhile reads again, a few times at most. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include "link.h"

#define TRIES 100
#define POLL 20000 /* ns between looks of the robot */

typedef struct {
  int64_t commands, states; /* counts */
  dqc_command command;
  dqc_state state;
} memory;

static memory *shared;
static int64_t seen;

static int map(int file) {
  if (file < 0 || ftruncate(file, sizeof *shared)) return -1;
  shared = mmap(0, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  close(file);
  return shared == MAP_FAILED ? -1 : 0;
}

int link_as_robot(const char *place) {
  if (map(shm_open(place, O_CREAT | O_RDWR, 0600))) return -1;
  memset(shared, 0, sizeof *shared);
  return 0;
}

int link_as_loop(const char *place) { return map(shm_open(place, O_RDWR, 0600)); }

static void put(int64_t *count, void *to, const void *from, size_t size) {
  __atomic_fetch_add(count, 1, __ATOMIC_SEQ_CST);
  memcpy(to, from, size);
  __atomic_fetch_add(count, 1, __ATOMIC_SEQ_CST);
}

/* Copy what has been put since, if it is whole. */
static int take(const int64_t *count, void *to, const void *from, size_t size) {
  for (int i = 0; i < TRIES; i++) {
    int64_t before = __atomic_load_n(count, __ATOMIC_SEQ_CST);
    if (before == seen) return 0;
    if (before & 1) continue;
    memcpy(to, from, size);
    __atomic_thread_fence(__ATOMIC_SEQ_CST);
    if (__atomic_load_n(count, __ATOMIC_SEQ_CST) != before) continue;
    seen = before;
    return 1;
  }
  return 0;
}

void link_send_command(const dqc_command *command) {
  put(&shared->commands, &shared->command, command, sizeof *command);
}

int link_has_state(void) { return __atomic_load_n(&shared->states, __ATOMIC_SEQ_CST) > 1; }

int link_take_state(dqc_state *state) { return take(&shared->states, state, &shared->state, sizeof *state); }

int link_await_command(dqc_command *command, int patience) {
  const struct timespec pause = {0, POLL};
  struct timespec begin, now;
  clock_gettime(CLOCK_MONOTONIC, &begin);
  do {
    if (take(&shared->commands, command, &shared->command, sizeof *command)) return 1;
    nanosleep(&pause, 0);
    clock_gettime(CLOCK_MONOTONIC, &now);
  } while (now.tv_sec - begin.tv_sec <= patience);
  return 0;
}

void link_send_state(const dqc_state *state) { put(&shared->states, &shared->state, state, sizeof *state); }

void link_leave(const char *place) { shm_unlink(place); }
