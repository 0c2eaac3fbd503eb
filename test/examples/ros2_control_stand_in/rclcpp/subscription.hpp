// Declares what the example controller uses of rclcpp (Jazzy); nothing here is linked.
#pragma once
#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace rclcpp
{
class Time {};
class Duration
{
public:
  double seconds() const;
};
class Logger {};
class Clock {};
class SystemDefaultsQoS {};
class Parameter
{
public:
  std::vector<std::string> as_string_array() const;
  std::vector<double> as_double_array() const;
  double as_double() const;
};
template <class Message>
class Subscription
{
public:
  using SharedPtr = std::shared_ptr<Subscription<Message>>;
};
}  // namespace rclcpp

inline void stand_in_log(const rclcpp::Logger &, const char *, ...) {}
#define RCLCPP_ERROR(logger, ...) stand_in_log(logger, __VA_ARGS__)
#define RCLCPP_WARN_THROTTLE(logger, clock, period, ...) ((void)(clock), (void)(period), stand_in_log(logger, __VA_ARGS__))
