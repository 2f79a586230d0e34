// A double for tests.
#pragma once
#include <cstdio>
namespace rclcpp {
struct Logger {};
}  // namespace rclcpp
#define RCLCPP_ERROR(logger, ...) ((void)(logger), std::fprintf(stderr, __VA_ARGS__), std::fprintf(stderr, "\n"))
