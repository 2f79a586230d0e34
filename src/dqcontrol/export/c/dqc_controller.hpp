// The controller for C++11 and later: the same library, with arrays that know their sizes.
#ifndef DQC_CONTROLLER_HPP
#define DQC_CONTROLLER_HPP

#include <array>

#include "dqc_controller.h"

namespace dqc {

using Configuration = std::array<double, DQC_COORDINATES>;  // rad or m
using Command = std::array<double, DQC_INPUTS>;             // rad/s or m/s

/// One controller; copies of it go their own ways. It throws nothing and allocates nothing.
class Controller {
 public:
  explicit Controller(const dqc_config& config = dqc_default_config()) noexcept
      : controller_(), status_(dqc_init(&controller_, &config)) {}

  /// DQC_OK, or why the configuration was refused.
  int status() const noexcept { return status_; }

  int step(const Configuration& q, double time, Command& u, const dqc_target* target = nullptr) noexcept {
    return dqc_step(&controller_, q.data(), time, target, u.data());
  }
  int step(const dqc_measured& measured, double time, Command& u, const dqc_target* target = nullptr) noexcept {
    return dqc_step_measured(&controller_, &measured, time, target, u.data());
  }
  int end() noexcept { return dqc_end(&controller_); }
  int stop() noexcept { return dqc_stop(&controller_); }
  int reset() noexcept { return dqc_reset(&controller_); }
  int set(const char* name, double value) noexcept { return dqc_set(&controller_, name, value); }
  int get(const char* name, double& value) const noexcept { return dqc_get(&controller_, name, &value); }
  const dqc_controller& data() const noexcept { return controller_; }
  static const char* text(int status) noexcept { return dqc_status_text(status); }

 private:
  dqc_controller controller_;
  int status_;
};

}  // namespace dqc
#endif
