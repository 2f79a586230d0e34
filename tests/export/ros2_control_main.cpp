// The ros2_control controller on a robot of ideal joints, with doubles of the headers.
#include <cstdio>
#include "controller_interface/controller_interface.hpp"
#include "dqc_controller.h"
controller_interface::ControllerInterface* make_controller();
int main() {
  auto* c = make_controller();
  std::vector<std::string> joints;
  for (int i = 0; i < DQC_COORDINATES; i++) joints.push_back("j" + std::to_string(i));
  c->node_->parameters["joints"].value = std::vector<std::string>{"one"};
  c->on_init();
  if (c->on_configure({}) != controller_interface::CallbackReturn::ERROR) return 1;
  c->node_->parameters["joints"].value = joints;
  if (c->on_configure({}) != controller_interface::CallbackReturn::SUCCESS) return 2;
  c->command_interfaces_.resize(c->command_interface_configuration().names.size());
  c->state_interfaces_.resize(c->state_interface_configuration().names.size());
  const double q[] = {0, 0.6283, 0, 1.5708, 0, 0.6283, 0};  // where the spec starts
  for (int i = 0; i < 7; i++) c->state_interfaces_[i].value = q[i];
  if (c->on_activate({}) != controller_interface::CallbackReturn::SUCCESS) return 3;
  for (int k = 0; k < 500; k++) {
    if (c->update(rclcpp::Time(100.0 + k * DQC_PERIOD), rclcpp::Duration(DQC_PERIOD)) != controller_interface::return_type::OK) return 4;
    for (int i = 0; i < 7; i++) c->state_interfaces_[i].value += DQC_PERIOD * c->command_interfaces_[i].value;
  }
  std::printf("at the end: %g %g\n", c->state_interfaces_[0].value, c->state_interfaces_[3].value);
  if (c->on_deactivate({}) != controller_interface::CallbackReturn::SUCCESS) return 5;
}
