/* A controller as a library: @DESCRIPTION@
 *
 * Made by dqcontrol @DQCONTROL@ for @TARGET@. One struct is one controller: put it where you like, and have as many as
 * you like. The functions allocate nothing, wait for nothing, print nothing, keep no time and have no state but the
 * struct; each controller may be used by one thread at a time. Units: rad, m, s.
 *
 *     static dqc_controller controller;
 *     dqc_init(&controller, 0);
 *     for each period: status = dqc_step(&controller, q, time, 0, u);   // u goes to the robot, whatever the status
 */
#ifndef DQC_CONTROLLER_H
#define DQC_CONTROLLER_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define DQC_VERSION_MAJOR @MAJOR@
#define DQC_VERSION_MINOR @MINOR@
#define DQC_VERSION_PATCH @PATCH@
#define DQC_VERSION "@VERSION@"  /* of this interface */
#define DQC_LAW_HASH "@HASH@"    /* of the law, its numbers, the supervisor, the reference and the target */
#define DQC_ROBOT "@ROBOT@"
#define DQC_LAW "@LAW@"

#define DQC_COORDINATES @COORDINATES@  /* numbers of a configuration q, rad or m */
#define DQC_INPUTS @INPUTS@       /* numbers of a command u, rad/s or m/s */
#define DQC_PERIOD @PERIOD@ /* s */
#define DQC_SUPERVISED @SUPERVISED@   /* whether a supervisor stands between law and robot */
#define DQC_STREAMED @STREAMED@     /* whether poses and twists may be its target */
#define DQC_HAS_CONTACT @HAS_CONTACT@ /* whether the law gives way to the wrench at the hand */
#define DQC_PARAMETERS @PARAMETERS@   /* numbers that may be changed, see dqc_set */
#define DQC_DURATION @DURATION@ /* of the spec's reference, s */

/* What dqc_step and the others return: below 0 something is wrong with the call. */
enum {
  DQC_OK = 0,       /* follows the law */
  DQC_STOPPING = 1, /* brakes */
  DQC_STOPPED = 2,  /* rests after a stop, and holds until dqc_reset */
  DQC_ENDED = 3,    /* rests because the reference is over or an end was asked for; u is 0 until dqc_reset */
  DQC_NULL_POINTER = -1,
  DQC_NOT_INITIALISED = -2,
  DQC_WRONG_ROBOT = -3, /* the configuration names another number of joints or inputs */
  DQC_NOT_FINITE = -4,
  DQC_OUTSIDE_LIMITS = -5, /* the robot is where it may not start from */
  DQC_LAW_FAILED = -6,     /* and there is no supervisor to brake: u is 0 */
  DQC_WRONG_TARGET = -7,   /* a pose or twist that is none, or none is taken: it was ignored; said while the law is followed */
  DQC_UNKNOWN_PARAMETER = -8,
  DQC_VALUE_OUTSIDE = -9, /* of the bounds of the parameter; nothing was changed */
  DQC_MOVING = -10,       /* only possible at rest */
  DQC_NO_MEASUREMENT = -11 /* and there is no supervisor to brake: u is 0 */
};

/* Where the desired motion comes from. */
enum { DQC_FROM_SPEC = 0, DQC_FROM_POSES = 1, DQC_FROM_TWISTS = 2 };

typedef struct {
  int32_t coordinates, inputs; /* of the robot at hand: DQC_COORDINATES and DQC_INPUTS, or nothing is done */
  int32_t source;              /* DQC_FROM_… */
  double linear_speed;         /* bounds of streamed targets, m/s */
  double angular_speed;        /* rad/s */
  double twist_timeout;        /* after which a twist no longer counts, s */
  double pose_timeout;         /* the same of poses; 0: they always count */
  double acceleration;         /* of streamed targets, m/s²; that of turns in proportion to the speeds */
} dqc_config;

/* A streamed target: what is asked of the hand, in the frame of the robot's base. */
typedef struct {
  double position[3]; /* m; with DQC_FROM_POSES */
  double rotation[4]; /* unit quaternion, scalar first */
  double linear[3];   /* m/s; with DQC_FROM_TWISTS */
  double angular[3];  /* rad/s */
  int32_t of_hand;    /* whether linear and angular are in the axes of the hand, not of the base */
} dqc_target;

/* What is measured. */
typedef struct {
  const double *q;      /* DQC_COORDINATES numbers; null if none came */
  double age;           /* of q, s */
  double elapsed;       /* since the last step by a clock of your own, s; 0: as the time of steps says */
  const double *effort; /* DQC_INPUTS numbers, N m or N; null if not measured */
  const double *wrench; /* force and torque at the hand, N and N m; null, or NaN, if not measured */
} dqc_measured;

/* A number that may be changed while the controller exists. */
typedef struct {
  const char *name; /* as in the spec: "law.gain", "supervisor.acceleration" */
  double value;     /* as exported */
  double least, most;
  int32_t only_at_rest;
} dqc_parameter;

/* A controller: look at what has a name without underscore at its end, write to nothing. */
typedef struct {
  double command[DQC_INPUTS];
  double wanted[DQC_INPUTS];        /* what the law says, before the supervisor */
  double measured[DQC_COORDINATES]; /* last measured */
  double sample[21];                /* desired pose (8), twist (6), twist rate (6) and time */
  double time;                      /* of the reference, s */
  uint32_t interventions;           /* what the supervisor did in the last step, one bit each */
  int32_t status;                   /* of the last step */

  double memory_[@MEMORY@];
  double state_[@STATE@];
  double supervisor_[@SUPERVISOR@];
  double supervisor_state_[@SUPERVISOR_STATE@];
  double moving_[@MOVING_SIZE@];
  double asked_[9];
  double parameters_[DQC_PARAMETERS + 1];
  int64_t plan_[@PLAN@];
  double origin_, stamp_, seen_, still_;
  dqc_config config_;
  int32_t phase_, request_, asks_;
  uint32_t magic_;
} dqc_controller;

/* Return the configuration as exported. */
dqc_config dqc_default_config(void);

/* Make a controller ready; null as configuration: as exported. Refused while it moves: what it is in must be zero, as
 * static memory is, before the first time. */
int dqc_init(dqc_controller *controller, const dqc_config *config);

/* Write the command of one period; the first one after dqc_init or dqc_reset starts from a robot at rest at q.
 *
 * q: measured, null if no measurement came. time: s, of any origin, as the robot or a steady clock says; it must neither
 * go back nor stand still. target: of a controller with streamed targets what is asked now, null if nothing new is. u: always written, and
 * always within the supervisor's limits if there is one.
 */
int dqc_step(dqc_controller *controller, const double *q, double time, const dqc_target *target, double *u);

/* The same with all that a robot may measure. */
int dqc_step_measured(dqc_controller *controller, const dqc_measured *measured, double time,
                      const dqc_target *target, double *u);

/* From the next step on: come to rest softly, the law followed meanwhile; or brake as hard as the supervisor may. */
int dqc_end(dqc_controller *controller);
int dqc_stop(dqc_controller *controller);

/* Be ready to start again from where the robot rests; refused while it moves. */
int dqc_reset(dqc_controller *controller);

/* Change a parameter, or read it. */
int dqc_set(dqc_controller *controller, const char *name, double value);
int dqc_get(const dqc_controller *controller, const char *name, double *value);
extern const dqc_parameter dqc_parameters[DQC_PARAMETERS + 1]; /* the last one has no name */

/* The position command and its rate, for robots that take positions; null without supervisor. */
const double *dqc_position(const dqc_controller *controller);
const double *dqc_rate(const dqc_controller *controller);

/* Words for a status, and for bit k of the interventions; "unknown" for others. */
const char *dqc_status_text(int status);
const char *dqc_intervention_text(int bit);

/* Version and hash that the library was made with: compare them with those of this header. */
const char *dqc_version(void);
const char *dqc_law_hash(void);

#ifdef __cplusplus
}
#endif
#endif
