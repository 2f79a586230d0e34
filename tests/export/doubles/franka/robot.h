// A double of libfranka's header for tests: an arm that does at once what it is told.
#pragma once
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>

#include "franka/exception.h"

namespace franka {
struct Duration {
  double seconds;
  double toSec() const { return seconds; }
};
struct RobotState {
  std::array<double, 7> q;
};
struct JointVelocities {
  explicit JointVelocities(const std::array<double, 7>& given) : dq(given) {}
  std::array<double, 7> dq;
  bool motion_finished = false;
};
inline JointVelocities MotionFinished(JointVelocities command) { return command.motion_finished = true, command; }

class Robot {
 public:
  explicit Robot(const std::string& address) {
    if (address != "double") throw Exception("no robot at " + address);
  }
  void setCollisionBehavior(const std::array<double, 7>&, const std::array<double, 7>&, const std::array<double, 6>&,
                            const std::array<double, 6>&) {}
  void control(std::function<JointVelocities(const RobotState&, Duration)> callback) {
    RobotState state{{0, -0.785398, 0, -2.356194, 0, 1.570796, 0.785398}};
    double fastest = 0.0, seconds = 0.0;
    for (long k = 0;; k++) {
      const JointVelocities command = callback(state, {seconds});
      if (command.motion_finished) break;
      if (k > 100000) throw Exception("it never ends");
      seconds = 1e-3;
      for (int i = 0; i < 7; i++) {
        if (!std::isfinite(command.dq[i])) throw Exception("not finite");
        fastest = std::fmax(fastest, std::fabs(command.dq[i]));
        state.q[i] += seconds * command.dq[i];
      }
    }
    std::printf("fastest joint %g rad/s\n", fastest);
  }
};
}  // namespace franka
