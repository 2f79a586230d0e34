// franka_velocity ADDRESS: the exported controller as the callback of libfranka, which calls it each millisecond.
//
// Export with a period of 1 ms, and with a supervisor whose acceleration and jerk keep Franka's limits. The robot's time
// counts: a late packet makes it jump by several periods, which the reference then takes one and a half at a time.
#include <franka/exception.h>
#include <franka/robot.h>

#include <array>
#include <cmath>
#include <cstdio>

#include "dqc_controller.hpp"

static_assert(DQC_COORDINATES == 7 && DQC_INPUTS == 7, "a Franka arm has 7 joints");

int main(int count, char** words) {
  if (count != 2) return std::fprintf(stderr, "usage: franka_velocity ADDRESS\n"), 2;
  if (std::fabs(DQC_PERIOD - 1e-3) > 1e-12) return std::fprintf(stderr, "export with a period of 1 ms\n"), 2;
  static dqc::Controller controller;
  double time = 0.0;
  int status = DQC_OK;
  try {
    franka::Robot robot(words[1]);
    robot.setCollisionBehavior({{20, 20, 18, 18, 16, 14, 12}}, {{20, 20, 18, 18, 16, 14, 12}}, {{20, 20, 20, 25, 25, 25}},
                               {{20, 20, 20, 25, 25, 25}});
    robot.control([&](const franka::RobotState& state, franka::Duration period) -> franka::JointVelocities {
      time += period.toSec();
      dqc::Command u;
      status = controller.step(state.q, time, u);
      const franka::JointVelocities command(u);
      return status == DQC_OK || status == DQC_STOPPING ? command : franka::MotionFinished(command);
    });
  } catch (const franka::Exception& error) {
    return std::fprintf(stderr, "%s\n", error.what()), 1;
  }
  std::printf("%s\n", dqc::Controller::text(status));
  return status < 0;
}
