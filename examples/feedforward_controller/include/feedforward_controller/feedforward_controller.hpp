// A ros2_control controller that feeds the torque of an identified model forward.
#ifndef FEEDFORWARD_CONTROLLER__FEEDFORWARD_CONTROLLER_HPP_
#define FEEDFORWARD_CONTROLLER__FEEDFORWARD_CONTROLLER_HPP_

#include <memory>
#include <string>
#include <vector>

#include "controller_interface/chainable_controller_interface.hpp"
#include "feedforward_controller/feedforward.hpp"
#include "feedforward_controller/model.hpp"
#include "rclcpp/subscription.hpp"
#include "rclcpp_lifecycle/state.hpp"
#include "realtime_tools/realtime_buffer.hpp"
#include "trajectory_msgs/msg/joint_trajectory_point.hpp"

namespace feedforward_controller
{

// Reference interfaces: position, velocity and acceleration of every joint, from a joint trajectory controller in front
// of it, or from the topic ~/reference. It commands `effort` and reads `position` and `velocity`.
class FeedforwardController : public controller_interface::ChainableControllerInterface
{
public:
  controller_interface::CallbackReturn on_init() override;
  controller_interface::InterfaceConfiguration command_interface_configuration() const override;
  controller_interface::InterfaceConfiguration state_interface_configuration() const override;
  controller_interface::CallbackReturn on_configure(const rclcpp_lifecycle::State & previous) override;
  controller_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State & previous) override;
  controller_interface::CallbackReturn on_deactivate(const rclcpp_lifecycle::State & previous) override;
  controller_interface::return_type update_and_write_commands(
    const rclcpp::Time & time, const rclcpp::Duration & period) override;

protected:
  std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() override;
  bool on_set_chained_mode(bool chained) override;
  controller_interface::return_type update_reference_from_subscribers(
    const rclcpp::Time & time, const rclcpp::Duration & period) override;

private:
  using Point = trajectory_msgs::msg::JointTrajectoryPoint;
  using Core = Feedforward<kJoints>;

  bool read_settings();
  void read_state(Core::Vector & q, Core::Vector & dq) const;

  std::vector<std::string> joints_;
  Core core_{kTorque, kGravity};
  Core::Settings settings_;
  rclcpp::Subscription<Point>::SharedPtr subscription_;
  realtime_tools::RealtimeBuffer<std::shared_ptr<Point>> point_;
};

}  // namespace feedforward_controller

#endif  // FEEDFORWARD_CONTROLLER__FEEDFORWARD_CONTROLLER_HPP_
