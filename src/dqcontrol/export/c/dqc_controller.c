/* What dqc_controller.h declares: how time, measurement, law and supervisor come together in one step.
 *
 * It does what dqcontrol's Control.step does in Python, with the same compiled functions; those take arrays as seven
 * words, which only this file knows.
 */
#include "dqc_controller.h"

#include <math.h>
#include <string.h>

#include "dqc_kernels.h"

#define MAGIC 0x64716331u
#define FASTEST_REFERENCE 1.5 /* periods that the reference's time advances a step at most */

enum { INACTIVE, ACTIVE, STOPPING, STOPPED, ENDED };
enum { GO, END, STOP_NOW };

dqc_config dqc_default_config(void) {
  dqc_config config = {DQC_COORDINATES, DQC_INPUTS, DQC_FROM_SPEC, 0.1, 0.5, 0.1, 0.0, 1.0};
  return config;
}

static int is_finite(const double *values, int count) {
  double sum = 0.0;
  for (int i = 0; i < count; i++) sum += 0.0 * values[i];
  return sum == 0.0;
}

static int64_t row_of(double time) {
  double row = rint(time / DQC_PERIOD);
  if (!(row > 0.0)) return 0;
  return row < 9e15 ? (int64_t)row : (int64_t)9e15;
}

static void write_zeros(double *u) {
  for (int i = 0; u && i < DQC_INPUTS; i++) u[i] = 0.0;
}

/* Without supervisor nothing brakes it, and nothing needs to wait for that. */
static int is_moving(const dqc_controller *controller) {
  return DQC_SUPERVISED && (controller->phase_ == ACTIVE || controller->phase_ == STOPPING);
}

int dqc_init(dqc_controller *controller, const dqc_config *config) {
  if (!controller) return DQC_NULL_POINTER;
  if (controller->magic_ == MAGIC && is_moving(controller)) return DQC_MOVING;
  dqc_config chosen = config ? *config : dqc_default_config();
  controller->magic_ = 0;
  if (chosen.coordinates != DQC_COORDINATES || chosen.inputs != DQC_INPUTS) return DQC_WRONG_ROBOT;
  if (chosen.source < DQC_FROM_SPEC || chosen.source > DQC_FROM_TWISTS) return DQC_WRONG_TARGET;
  if (chosen.source != DQC_FROM_SPEC && !DQC_STREAMED) return DQC_WRONG_TARGET;
  if (!(chosen.linear_speed > 0.0) || !(chosen.angular_speed > 0.0) || !(chosen.twist_timeout > 0.0) ||
      !(chosen.pose_timeout >= 0.0) || !(chosen.acceleration > 0.0))
    return DQC_VALUE_OUTSIDE;
  if (!is_finite(&chosen.linear_speed, 1) || !is_finite(&chosen.angular_speed, 1) ||
      !is_finite(&chosen.twist_timeout, 1) || !is_finite(&chosen.pose_timeout, 1) || !is_finite(&chosen.acceleration, 1))
    return DQC_NOT_FINITE;
  memset(controller, 0, sizeof *controller);
  memcpy(controller->memory_, dqc_law_memory, DQC_MEMORY * sizeof(double));
  memcpy(controller->plan_, dqc_plan, sizeof controller->plan_);
  LINK_STAGES(controller->plan_)
#if DQC_SUPERVISED
  memcpy(controller->supervisor_, dqc_supervisor_memory, DQC_SUPERVISOR * sizeof(double));
#endif
  for (int i = 0; i < DQC_PARAMETERS; i++) controller->parameters_[i] = dqc_parameters[i].value;
  controller->config_ = chosen;
  controller->magic_ = MAGIC;
  return DQC_OK;
}

/* Begin from a robot at rest at q. */
static int start(dqc_controller *controller, const double *q, double time) {
  if (!q) return DQC_NULL_POINTER;
  if (!is_finite(q, DQC_COORDINATES) || !is_finite(&time, 1)) return DQC_NOT_FINITE;
#if DQC_SUPERVISED
  const double *lower = controller->supervisor_ + DQC_LOWER, *upper = controller->supervisor_ + DQC_UPPER;
  for (int i = 0; i < DQC_INPUTS; i++) {
    double position = q[dqc_input_coordinates[i]];
    if (position < lower[i] - DQC_START_TOLERANCE || position > upper[i] + DQC_START_TOLERANCE) return DQC_OUTSIDE_LIMITS;
  }
  double *state = controller->supervisor_state_;
  memset(state, 0, sizeof controller->supervisor_state_);
  state[DQC_LATENESS] = 1.0;
  memcpy(state + DQC_GOOD, q, DQC_COORDINATES * sizeof(double));
  for (int i = 0; i < DQC_INPUTS; i++) {
    state[DQC_SENT + i] = state[DQC_POSITION + i] = state[DQC_SENT_THEN + i] = q[dqc_input_coordinates[i]];
    state[DQC_USUAL_EFFORT + i] = NAN;
  }
#endif
#if DQC_LOOKS_AT_START
  int64_t refused;
  void *failure;
  dqc_kernel_check_start(&refused, &failure, NUMBERS(controller->supervisor_, DQC_SUPERVISOR),
                         NUMBERS(state, DQC_SUPERVISOR_STATE));
  if (refused) return DQC_OUTSIDE_LIMITS;
#endif
  memcpy(controller->state_, dqc_law_state, DQC_STATE * sizeof(double));
  for (int i = 0; i < DQC_STARTS; i++) controller->state_[dqc_starts[i][0]] = q[dqc_starts[i][1]];
  memcpy(controller->measured, q, DQC_COORDINATES * sizeof(double));
  memset(controller->wanted, 0, sizeof controller->wanted);
  memset(controller->command, 0, sizeof controller->command);
  memset(controller->sample, 0, sizeof controller->sample);
  controller->time = controller->stamp_ = controller->seen_ = controller->still_ = 0.0;
  controller->origin_ = time;
  controller->asks_ = 0;
#if DQC_STREAMED
  if (controller->config_.source != DQC_FROM_SPEC) {
    int64_t result;
    void *raised;
    memset(controller->moving_, 0, sizeof controller->moving_);
    dqc_kernel_forward(&result, &raised, ROWS(controller->memory_, DQC_TABLE_ROWS, DQC_TABLE_COLUMNS),
                       NUMBERS(controller->measured, DQC_COORDINATES), NUMBERS(controller->moving_, 8));
  }
#endif
  controller->phase_ = ACTIVE;
  if (controller->request_ == END) controller->request_ = GO;
  return DQC_OK;
}

/* Keep what is asked of a streamed target; of what is none, the hand is to stay where it is. */
static int ask(dqc_controller *controller, const dqc_target *target) {
#if DQC_STREAMED
  const dqc_config *config = &controller->config_;
  if (!target) return DQC_OK;
  if (config->source == DQC_FROM_SPEC) return DQC_WRONG_TARGET;
  if (config->source == DQC_FROM_POSES) {
    const double *r = target->rotation, *p = target->position;
    double norm = sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3]);
    controller->asks_ = 1;
    controller->asked_[8] = controller->time;
    if (!is_finite(p, 3) || !(fabs(norm - 1.0) <= 1e-3)) {
      controller->asked_[0] = NAN;
      return DQC_WRONG_TARGET;
    }
    double w = r[0] / norm, x = r[1] / norm, y = r[2] / norm, z = r[3] / norm;
    double a = 0.5 * p[0], b = 0.5 * p[1], c = 0.5 * p[2], *goal = controller->asked_;
    goal[0] = w, goal[1] = x, goal[2] = y, goal[3] = z;
    goal[4] = -a * x - b * y - c * z;
    goal[5] = a * w + b * z - c * y;
    goal[6] = b * w + c * x - a * z;
    goal[7] = c * w + a * y - b * x;
  } else {
    const double *v = target->linear, *w = target->angular;
    if (!is_finite(v, 3) || !is_finite(w, 3)) {
      for (int i = 0; i < 6; i++) controller->asked_[i] = 0.0;
      return DQC_WRONG_TARGET;
    }
    double linear = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    double angular = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    double share = fmin(1.0, fmin(config->linear_speed / fmax(linear, 1e-12), config->angular_speed / fmax(angular, 1e-12)));
    for (int i = 0; i < 3; i++) {
      controller->asked_[i] = share * w[i];
      controller->asked_[3 + i] = share * v[i];
    }
    controller->asked_[6] = controller->time;
    controller->asked_[7] = target->of_hand ? 1.0 : 0.0;
  }
  controller->asks_ = 1;
  return DQC_OK;
#else
  (void)controller;
  return target ? DQC_WRONG_TARGET : DQC_OK;
#endif
}

/* Write the desired motion now into the controller's sample; return whether the reference is over. */
static int is_over(const dqc_controller *controller, int64_t row) {
  return controller->config_.source == DQC_FROM_SPEC && row >= DQC_SAMPLES;
}

static void desire(dqc_controller *controller, int64_t row) {
#if DQC_STREAMED
  if (controller->config_.source != DQC_FROM_SPEC) {
    int64_t result;
    void *raised;
    double pose[8];
    const dqc_config *config = &controller->config_;
    double pose_timeout = config->pose_timeout > 0.0 ? config->pose_timeout : INFINITY;
    const double speeds[4] = {config->linear_speed, config->angular_speed,
                              config->source == DQC_FROM_POSES ? pose_timeout : config->twist_timeout,
                              config->acceleration};
    dqc_kernel_forward(&result, &raised, ROWS(controller->memory_, DQC_TABLE_ROWS, DQC_TABLE_COLUMNS),
                       NUMBERS(controller->measured, DQC_COORDINATES), NUMBERS(pose, 8));
    if (controller->config_.source == DQC_FROM_POSES)
      dqc_kernel_to_pose(&result, &raised, NUMBERS(pose, 8), controller->time,
                         NUMBERS(controller->asked_, controller->asks_ ? 9 : 0), NUMBERS(speeds, 4),
                         NUMBERS(controller->moving_, DQC_MOVING_SIZE));
    else
      dqc_kernel_by_twist(&result, &raised, NUMBERS(pose, 8), controller->time,
                          NUMBERS(controller->asked_, controller->asks_ ? 8 : 0), NUMBERS(speeds, 4),
                          NUMBERS(controller->moving_, DQC_MOVING_SIZE));
    memcpy(controller->sample, controller->moving_, sizeof controller->sample);
    return;
  }
#endif
  if (row >= DQC_SAMPLES) row = DQC_SAMPLES - 1;
#if DQC_REFERENCE_RESTS
  memcpy(controller->sample, dqc_reference, sizeof controller->sample);
  controller->sample[20] = (double)row * DQC_PERIOD;
#elif DQC_REFERENCE_COMPUTED
  int64_t result;
  void *raised;
  dqc_kernel_reference(&result, &raised, NUMBERS(dqc_reference, DQC_REFERENCE), (double)row * DQC_PERIOD,
                       NUMBERS(controller->sample, 21));
#else
  memcpy(controller->sample, dqc_reference + 21 * row, sizeof controller->sample);
#endif
}

/* Law and supervisor need kinematics at the same q: find them once, where no law writes. Return 0, or why not. */
static int64_t find_kinematics(dqc_controller *controller) {
#if DQC_SHARES_KINEMATICS
  int64_t status;
  void *raised;
  double *found = controller->supervisor_ + DQC_BUFFER, *of_law = controller->memory_ + DQC_LAW_KINEMATICS;
  dqc_kernel_kinematics(&status, &raised, ROWS(controller->supervisor_ + DQC_CHAIN, DQC_TABLE_ROWS, DQC_TABLE_COLUMNS),
                        NUMBERS(controller->measured, DQC_COORDINATES), NUMBERS(found, DQC_KINEMATICS));
  memcpy(of_law, found, 8 * sizeof(double)); /* the pose, and the twist Jacobian; room for another is between them */
  memcpy(of_law + DQC_TWIST_JACOBIAN, found + DQC_TWIST_JACOBIAN, (DQC_KINEMATICS - DQC_TWIST_JACOBIAN) * sizeof(double));
  return status;
#else
  (void)controller;
  return 0;
#endif
}

/* Write what the law wants, NaN if it cannot say, and whether the supervisor has the kinematics. */
static int ask_law(dqc_controller *controller, const double *wrench, int64_t row, int *known) {
  int64_t status = 1;
  void *raised;
  if (is_finite(controller->measured, DQC_COORDINATES)) {
    desire(controller, row);
#if DQC_HAS_CONTACT
    for (int i = 0; i < 6; i++) controller->memory_[DQC_WRENCH_AT + i] = wrench ? wrench[i] : NAN;
#else
    (void)wrench;
#endif
    status = find_kinematics(controller);
    *known = DQC_SHARES_KINEMATICS && !status;
    if (!status)
      dqc_kernel_step(&status, &raised, NUMBERS(controller->plan_, DQC_PLAN), NUMBERS(controller->memory_, DQC_MEMORY),
                      NUMBERS(controller->measured, DQC_COORDINATES), NUMBERS(controller->sample, 21), row, DQC_PERIOD,
                      NUMBERS(controller->state_, DQC_STATE), NUMBERS(controller->wanted, DQC_INPUTS));
  }
  for (int i = 0; status && i < DQC_INPUTS; i++) controller->wanted[i] = NAN;
  return status == 0;
}

#if DQC_SUPERVISED
static const double NOTHING[1] = {0};

static int supervise(dqc_controller *controller, const dqc_measured *measured, double age, double elapsed, int law_asked,
                     int known) {
  int64_t result;
  void *raised;
  double *state = controller->supervisor_state_;
  const double *effort = measured->effort ? measured->effort : NOTHING;
  const double *wrench = measured->wrench ? measured->wrench : NOTHING;
  const double moment[DQC_MOMENT] = {age, elapsed, (double)controller->request_, (double)known, controller->still_};
  (void)law_asked;
  controller->request_ = GO;
  dqc_kernel_supervise(&result, &raised, (int64_t)(intptr_t)&dqc_kernel_kinematics,
                       NUMBERS(controller->supervisor_, DQC_SUPERVISOR), NUMBERS(moment, DQC_MOMENT),
                       NUMBERS(controller->measured, DQC_COORDINATES), NUMBERS(controller->wanted, DQC_INPUTS),
                       NUMBERS(effort, measured->effort ? DQC_INPUTS : 0), NUMBERS(wrench, measured->wrench ? 6 : 0),
                       NUMBERS(state, DQC_SUPERVISOR_STATE), NUMBERS(controller->command, DQC_INPUTS));
  int rests = result == DQC_AT_REST;
  dqc_kernel_sent(&result, &raised, NUMBERS(controller->plan_, DQC_PLAN), NUMBERS(controller->memory_, DQC_MEMORY),
                  NUMBERS(controller->state_, DQC_STATE), NUMBERS(controller->command, DQC_INPUTS));
  controller->interventions = (uint32_t)state[DQC_NOW];
  if (state[DQC_MODE] == DQC_MODE_STOPPED) {
    if (controller->phase_ != STOPPED) controller->phase_ = STOPPING;
    if (rests) controller->phase_ = (uint32_t)state[DQC_FAULT] == DQC_SOFT_STOP ? ENDED : STOPPED;
  }
  return controller->phase_ == ACTIVE ? DQC_OK : controller->phase_ == STOPPED ? DQC_STOPPED : DQC_STOPPING;
}
#else
static int supervise(dqc_controller *controller, const dqc_measured *measured, double age, double elapsed, int law_asked,
                     int known) {
  (void)age, (void)elapsed, (void)known;
  if (controller->request_ != GO || !law_asked) {
    write_zeros(controller->command);
    int failed = controller->request_ == GO;
    controller->phase_ = controller->request_ == END ? ENDED : STOPPED;
    controller->request_ = GO;
    return failed ? (measured->q ? DQC_LAW_FAILED : DQC_NO_MEASUREMENT) : controller->phase_ == ENDED ? DQC_ENDED : DQC_STOPPED;
  }
  memcpy(controller->command, controller->wanted, sizeof controller->command);
  return DQC_OK;
}
#endif

/* What a controller without supervisor, and one at its end, does: nothing. */
static int rest(dqc_controller *controller, double *u) {
  write_zeros(u);
  write_zeros(controller->command);
  return controller->phase_ == ENDED ? DQC_ENDED : DQC_STOPPED;
}

int dqc_step_measured(dqc_controller *controller, const dqc_measured *measured, double time,
                      const dqc_target *target, double *u) {
  if (!controller || !measured || !u) {
    write_zeros(u);
    return DQC_NULL_POINTER;
  }
  if (controller->magic_ != MAGIC) {
    write_zeros(u);
    return DQC_NOT_INITIALISED;
  }
  int status;
  if (controller->phase_ == INACTIVE && (status = start(controller, measured->q, time))) {
    write_zeros(u);
    return controller->status = status;
  }
  if (controller->phase_ == ENDED || (controller->phase_ == STOPPED && !DQC_SUPERVISED))
    return controller->status = rest(controller, u);
  int refused = ask(controller, target);
  double since = time - controller->origin_;
  double passed = controller->stamp_ != 0.0 || since != 0.0 ? since - controller->stamp_ : DQC_PERIOD;
  controller->still_ = since == controller->stamp_ ? controller->still_ + DQC_PERIOD : 0.0;
  controller->stamp_ = since;
  const double farthest = FASTEST_REFERENCE * DQC_PERIOD;
  if (since != 0.0 && passed > 0.0) controller->time += passed < farthest ? passed : farthest;
  int64_t row = row_of(controller->time);
  double elapsed = passed >= 0.0 && measured->elapsed > passed ? measured->elapsed : passed;
  if (controller->phase_ == ACTIVE && is_over(controller, row)) {
    controller->request_ = controller->request_ == GO ? END : controller->request_;
    controller->phase_ = STOPPING;
  }
  double age = measured->age;
  int law_asked = 0, known = 0;
  if (measured->q) {
    memcpy(controller->measured, measured->q, sizeof controller->measured);
    controller->seen_ = since;
    law_asked = ask_law(controller, measured->wrench, row, &known);
  } else if (!(age > since - controller->seen_)) {
    age = since - controller->seen_;
  }
  status = supervise(controller, measured, age, elapsed, law_asked, known);
  memcpy(u, controller->command, sizeof controller->command);
  if (controller->phase_ == ENDED && DQC_SUPERVISED) status = DQC_ENDED;
  return controller->status = status == DQC_OK && refused ? refused : status; /* a stop is not hidden */
}

int dqc_step(dqc_controller *controller, const double *q, double time, const dqc_target *target, double *u) {
  dqc_measured measured = {q, 0.0, 0.0, 0, 0};
  return dqc_step_measured(controller, &measured, time, target, u);
}

int dqc_end(dqc_controller *controller) {
  if (!controller) return DQC_NULL_POINTER;
  if (controller->magic_ != MAGIC) return DQC_NOT_INITIALISED;
  if (controller->phase_ == ACTIVE) {
    controller->request_ = END;
    controller->phase_ = STOPPING;
  }
  return DQC_OK;
}

int dqc_stop(dqc_controller *controller) {
  if (!controller) return DQC_NULL_POINTER;
  if (controller->magic_ != MAGIC) return DQC_NOT_INITIALISED;
  controller->request_ = STOP_NOW;
  if (controller->phase_ == ACTIVE) controller->phase_ = STOPPING;
  return DQC_OK;
}

int dqc_reset(dqc_controller *controller) {
  if (!controller) return DQC_NULL_POINTER;
  if (controller->magic_ != MAGIC) return DQC_NOT_INITIALISED;
  if (is_moving(controller)) return DQC_MOVING;
  controller->phase_ = INACTIVE;
  controller->request_ = GO;
  controller->interventions = 0;
  controller->status = DQC_OK;
  return DQC_OK;
}

static int parameter_named(const char *name) {
  for (int i = 0; i < DQC_PARAMETERS; i++)
    if (!strcmp(dqc_parameters[i].name, name)) return i;
  return -1;
}

int dqc_set(dqc_controller *controller, const char *name, double value) {
  if (!controller || !name) return DQC_NULL_POINTER;
  if (controller->magic_ != MAGIC) return DQC_NOT_INITIALISED;
  int chosen = parameter_named(name);
  if (chosen < 0) return DQC_UNKNOWN_PARAMETER;
  const dqc_parameter *parameter = &dqc_parameters[chosen];
  if (!(value >= parameter->least && value <= parameter->most)) return DQC_VALUE_OUTSIDE;
  if (parameter->only_at_rest && (controller->phase_ == ACTIVE || controller->phase_ == STOPPING)) return DQC_MOVING;
  for (int i = 0; i < DQC_PLACES; i++) {
    if (dqc_places[i].parameter != chosen) continue;
    double *numbers = dqc_places[i].of_supervisor ? controller->supervisor_ : controller->memory_;
    numbers[dqc_places[i].index] = dqc_places[i].offset + dqc_places[i].slope * value;
  }
  controller->parameters_[chosen] = value;
  return DQC_OK;
}

int dqc_get(const dqc_controller *controller, const char *name, double *value) {
  if (!controller || !name || !value) return DQC_NULL_POINTER;
  if (controller->magic_ != MAGIC) return DQC_NOT_INITIALISED;
  int chosen = parameter_named(name);
  if (chosen < 0) return DQC_UNKNOWN_PARAMETER;
  *value = controller->parameters_[chosen];
  return DQC_OK;
}

const double *dqc_position(const dqc_controller *controller) {
  if (!controller || !DQC_SUPERVISED) return 0;
  return controller->supervisor_state_ + DQC_SENT;
}

const double *dqc_rate(const dqc_controller *controller) {
  if (!controller || !DQC_SUPERVISED) return 0;
  return controller->supervisor_state_ + DQC_SENT_RATE;
}

const char *dqc_status_text(int status) {
  switch (status) {
    case DQC_OK: return "follows the law";
    case DQC_STOPPING: return "brakes";
    case DQC_STOPPED: return "stopped, holds until it is reset";
    case DQC_ENDED: return "ended, at rest";
    case DQC_NULL_POINTER: return "a pointer is null";
    case DQC_NOT_INITIALISED: return "dqc_init was not called, or failed";
    case DQC_WRONG_ROBOT: return "the robot has another number of joints than the controller was exported for";
    case DQC_NOT_FINITE: return "a number is NaN or infinite";
    case DQC_OUTSIDE_LIMITS: return "a joint is outside its limits, a hand outside its box or the base in a keep-out zone; move the robot by other means first";
    case DQC_LAW_FAILED: return "the law failed, and there is no supervisor to brake";
    case DQC_WRONG_TARGET: return "the target is none, or none of its kind is taken";
    case DQC_UNKNOWN_PARAMETER: return "there is no parameter of that name";
    case DQC_VALUE_OUTSIDE: return "the value is outside the bounds of the parameter";
    case DQC_MOVING: return "only possible at rest";
    case DQC_NO_MEASUREMENT: return "no measurement came, and there is no supervisor to brake";
    default: return "unknown";
  }
}

const char *dqc_intervention_text(int bit) {
  static const char *const texts[] = {@INTERVENTIONS@};
  return bit >= 0 && bit < (int)(sizeof texts / sizeof *texts) ? texts[bit] : "unknown";
}

const char *dqc_version(void) { return DQC_VERSION; }
const char *dqc_law_hash(void) { return DQC_LAW_HASH; }
