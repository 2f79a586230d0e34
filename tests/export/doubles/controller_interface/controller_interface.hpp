// A double of ros2_control's header for tests: as much as the exported controller asks for, and a robot behind it.
#pragma once
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "rclcpp/logging.hpp"

namespace rclcpp_lifecycle {
class State {};
}  // namespace rclcpp_lifecycle

namespace rclcpp {
class Time {
 public:
  explicit Time(double seconds) : seconds_(seconds) {}
  double seconds() const { return seconds_; }

 private:
  double seconds_;
};
using Duration = Time;

class Parameter {
 public:
  std::variant<std::string, std::vector<std::string>> value;
  std::vector<std::string> as_string_array() const { return std::get<1>(value); }
  std::string as_string() const { return std::get<0>(value); }
};

class Node {
 public:
  std::map<std::string, Parameter> parameters;
  Parameter get_parameter(const std::string& name) const { return parameters.at(name); }
  Logger get_logger() const { return {}; }
};
}  // namespace rclcpp

namespace controller_interface {
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };
struct InterfaceConfiguration {
  interface_configuration_type type;
  std::vector<std::string> names;
};

struct Interface {
  double value = 0.0;
  [[nodiscard]] std::optional<double> get_optional() const { return value; }
  [[nodiscard]] bool set_value(double given) { return value = given, true; }
};

class ControllerInterface {
 public:
  virtual ~ControllerInterface() = default;
  virtual CallbackReturn on_init() = 0;
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State&) = 0;
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State&) = 0;
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State&) = 0;
  virtual return_type update(const rclcpp::Time& time, const rclcpp::Duration& period) = 0;
  std::shared_ptr<rclcpp::Node> get_node() const { return node_; }

  template <typename Value>
  void auto_declare(const std::string& name, const Value& value) {
    if (!node_->parameters.count(name)) node_->parameters[name].value = value;
  }

  std::shared_ptr<rclcpp::Node> node_ = std::make_shared<rclcpp::Node>();
  std::vector<Interface> command_interfaces_, state_interfaces_;
};
}  // namespace controller_interface
