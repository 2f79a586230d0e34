// The exported controller as a controller of ros2_control (Jazzy and later): it takes positions, and commands velocities
// or positions. It follows the reference of its spec while it is active; deactivated, it is ready to start again.
//
// update() runs in the controller manager's real-time thread: it allocates nothing and waits for nothing.
#include <cmath>
#include <string>
#include <vector>

#include "controller_interface/controller_interface.hpp"
#include "dqc_controller.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/logging.hpp"

namespace dqc {

using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::interface_configuration_type;
using controller_interface::return_type;

class Ros2Controller : public controller_interface::ControllerInterface {
 public:
  CallbackReturn on_init() override {
    auto_declare<std::vector<std::string>>("joints", {});
    auto_declare<std::string>("interface_name", "velocity");
    return CallbackReturn::SUCCESS;
  }

  InterfaceConfiguration command_interface_configuration() const override { return interfaces(interface_name_); }
  InterfaceConfiguration state_interface_configuration() const override { return interfaces("position"); }

  CallbackReturn on_configure(const rclcpp_lifecycle::State&) override {
    joints_ = get_node()->get_parameter("joints").as_string_array();
    interface_name_ = get_node()->get_parameter("interface_name").as_string();
    const auto logger = get_node()->get_logger();
    if (joints_.size() != DQC_COORDINATES) {
      RCLCPP_ERROR(logger, "joints: expected %d names for %s, got %zu", DQC_COORDINATES, DQC_ROBOT, joints_.size());
      return CallbackReturn::ERROR;
    }
    if (interface_name_ != "velocity" && interface_name_ != "position") {
      RCLCPP_ERROR(logger, "interface_name: must be velocity or position, got %s", interface_name_.c_str());
      return CallbackReturn::ERROR;
    }
    if (interface_name_ == "position" && !DQC_SUPERVISED) {
      RCLCPP_ERROR(logger, "interface_name: positions need a controller with supervisor");
      return CallbackReturn::ERROR;
    }
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State&) override {
    controller_ = Controller();
    return controller_.status() == DQC_OK ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
  }

  CallbackReturn on_deactivate(const rclcpp_lifecycle::State&) override {
    for (auto& command : command_interfaces_) {
      if (interface_name_ == "velocity" && !command.set_value(0.0)) return CallbackReturn::ERROR;
    }
    return CallbackReturn::SUCCESS;
  }

  return_type update(const rclcpp::Time& time, const rclcpp::Duration& period) override {
    bool came = true;
    for (size_t i = 0; i < DQC_COORDINATES; i++) {
      const auto value = state_interfaces_[i].get_optional();
      came = came && value.has_value();
      if (value.has_value()) q_[i] = *value;
    }
    const dqc_measured measured = {came ? q_.data() : nullptr, 0.0, period.seconds(), nullptr, nullptr};
    const int status = controller_.step(measured, time.seconds(), u_);
    const double* sent = interface_name_ == "position" ? dqc_position(&controller_.data()) : u_.data();
    const bool started = status >= 0 || status == DQC_WRONG_TARGET || status == DQC_LAW_FAILED || status == DQC_NO_MEASUREMENT;
    for (size_t i = 0; i < DQC_INPUTS && (started || sent == u_.data()); i++) {
      if (!command_interfaces_[i].set_value(sent[i])) return return_type::ERROR;
    }
    return started ? return_type::OK : return_type::ERROR;
  }

 private:
  InterfaceConfiguration interfaces(const std::string& kind) const {
    InterfaceConfiguration found{interface_configuration_type::INDIVIDUAL, {}};
    for (const auto& joint : joints_) found.names.push_back(joint + "/" + kind);
    return found;
  }

  std::vector<std::string> joints_;
  std::string interface_name_ = "velocity";
  Controller controller_;
  Configuration q_{};
  Command u_{};
};

}  // namespace dqc

PLUGINLIB_EXPORT_CLASS(dqc::Ros2Controller, controller_interface::ControllerInterface)
