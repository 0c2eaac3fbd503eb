// Declares what the example controller uses of ros2_control (Jazzy); nothing here is linked.
#pragma once
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "rclcpp/subscription.hpp"
#include "rclcpp_lifecycle/state.hpp"

namespace hardware_interface
{
class CommandInterface
{
public:
  CommandInterface(const std::string & prefix, const std::string & name, double * value);
};
class LoanedCommandInterface
{
public:
  [[nodiscard]] bool set_value(double value);
};
class LoanedStateInterface
{
public:
  double get_value() const;
};
}  // namespace hardware_interface

namespace controller_interface
{
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };
struct InterfaceConfiguration
{
  interface_configuration_type type;
  std::vector<std::string> names;
};

class Node
{
public:
  rclcpp::Logger get_logger() const;
  std::shared_ptr<rclcpp::Clock> get_clock();
  const char * get_name() const;
  rclcpp::Parameter get_parameter(const std::string & name) const;
  template <class Message, class Callback>
  typename rclcpp::Subscription<Message>::SharedPtr create_subscription(
    const std::string &, const rclcpp::SystemDefaultsQoS &, Callback &&)
  {
    static_assert(std::is_invocable_v<Callback, std::shared_ptr<Message>>);
    return nullptr;
  }
};

class ChainableControllerInterface
{
public:
  virtual ~ChainableControllerInterface() = default;
  virtual CallbackReturn on_init() = 0;
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &);
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &);
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &);
  virtual return_type update_and_write_commands(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;

protected:
  virtual std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces();
  virtual bool on_set_chained_mode(bool chained);
  virtual return_type update_reference_from_subscribers(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;
  std::shared_ptr<Node> get_node() const;
  template <class T>
  T auto_declare(const std::string &, const T & value)
  {
    return value;
  }

  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;
  std::vector<double> reference_interfaces_;
};
}  // namespace controller_interface
