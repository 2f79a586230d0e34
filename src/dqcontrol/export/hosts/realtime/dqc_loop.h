/* A real-time loop around the controller: absolute deadlines, SCHED_FIFO, and every step noted in memory of yours. */
#ifndef DQC_LOOP_H
#define DQC_LOOP_H

#include "dqc_controller.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One step. */
typedef struct {
  double time;                   /* by deadlines, s */
  double begin;                  /* when it began, s since the first step */
  double computation;            /* of the controller, s */
  double idle;                   /* slept before it, s */
  double late;                   /* 1 if the work before it took longer than its deadline, else 0 */
  double sample[21];             /* desired pose, twist, twist rate, time of the reference */
  double q[DQC_COORDINATES];     /* where the robot truly is, if that is known, else as measured */
  double measured[DQC_COORDINATES];
  double command[DQC_INPUTS];
  double interventions, status;
} dqc_row;

/* A robot, by two functions that may not wait: what they wait for is late. */
typedef struct {
  void *robot;                                              /* handed to both */
  int (*measure)(void *robot, double *q, double *measured); /* where it is; return whether a measurement came */
  void (*command)(void *robot, const double *u);
} dqc_robot;

/* What others see of a loop and ask of it, also from other threads and processes. */
typedef struct {
  int64_t written;   /* steps noted so far; read it with dqc_loop_written */
  int64_t request;   /* set it with dqc_loop_request */
  int64_t is_done;   /* whether it has ended */
  int64_t status;    /* the controller's last one */
  int64_t real_time; /* whether the system gave SCHED_FIFO */
  int64_t missed;    /* periods that passed without a step */
  int64_t late;      /* steps that began late because of the work before them */
  int64_t heartbeat; /* changed at least every DQC_LOOP_PATIENCE s by who watches, or the loop stops; 0: nobody does */
} dqc_watch;

typedef struct {
  dqc_controller controller;
  dqc_watch *watch;
  dqc_row *rows;    /* room for steps */
  int64_t capacity; /* of rows: when they are full it comes to rest, and the last row has the last step */
} dqc_loop;

enum { DQC_LOOP_GO, DQC_LOOP_END, DQC_LOOP_STOP };
#define DQC_LOOP_PATIENCE 2.0 /* s: 40 looks of dqcontrol's */

/* Run until the controller has ended or stopped, and rests; priority: of SCHED_FIFO, 0 for none.
 * Return the controller's last status. Pages that a loop writes should be locked and written to before. */
int dqc_loop_run(dqc_loop *loop, const dqc_config *config, const dqc_robot *robot, int priority);

int64_t dqc_loop_written(const dqc_watch *watch);
void dqc_loop_request(dqc_watch *watch, int request);

#ifdef __cplusplus
}
#endif
#endif
