#include "feedforward_controller/feedforward_controller.hpp"

#include <algorithm>
#include <limits>

#include "hardware_interface/types/hardware_interface_type_values.hpp"
#include "pluginlib/class_list_macros.hpp"

namespace feedforward_controller
{

using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::interface_configuration_type;
using controller_interface::return_type;
using hardware_interface::HW_IF_ACCELERATION;
using hardware_interface::HW_IF_EFFORT;
using hardware_interface::HW_IF_POSITION;
using hardware_interface::HW_IF_VELOCITY;

namespace
{
constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kReferences = 3;  // position, velocity, acceleration of each joint, one after the other
}  // namespace

CallbackReturn FeedforwardController::on_init()
{
  auto_declare<std::vector<std::string>>("joints", {});
  auto_declare<std::vector<double>>("kp", {});
  auto_declare<std::vector<double>>("kd", {});
  auto_declare<std::vector<double>>("limit", {});
  auto_declare<double>("ramp", 1.0);
  return CallbackReturn::SUCCESS;
}

InterfaceConfiguration FeedforwardController::command_interface_configuration() const
{
  InterfaceConfiguration out{interface_configuration_type::INDIVIDUAL, {}};
  for (const auto & joint : joints_) {
    out.names.push_back(joint + "/" + HW_IF_EFFORT);
  }
  return out;
}

InterfaceConfiguration FeedforwardController::state_interface_configuration() const
{
  InterfaceConfiguration out{interface_configuration_type::INDIVIDUAL, {}};
  for (const auto & joint : joints_) {
    out.names.push_back(joint + "/" + HW_IF_POSITION);
    out.names.push_back(joint + "/" + HW_IF_VELOCITY);
  }
  return out;
}

bool FeedforwardController::read_settings()
{
  joints_ = get_node()->get_parameter("joints").as_string_array();
  if (joints_.size() != kJoints) {
    RCLCPP_ERROR(
      get_node()->get_logger(), "joints: %zu names, but the exported model has %zu joints", joints_.size(), kJoints);
    return false;
  }
  const std::array<std::pair<const char *, Core::Vector *>, 3> vectors{
    {{"kp", &settings_.kp}, {"kd", &settings_.kd}, {"limit", &settings_.limit}}};
  for (const auto & [name, into] : vectors) {
    const auto values = get_node()->get_parameter(name).as_double_array();
    const bool good = values.size() == kJoints &&
      std::all_of(values.begin(), values.end(), [](double x) { return std::isfinite(x) && x >= 0.0; });
    if (!good) {
      RCLCPP_ERROR(get_node()->get_logger(), "%s: %zu numbers, none negative, were expected", name, kJoints);
      return false;
    }
    std::copy(values.begin(), values.end(), into->begin());
  }
  settings_.ramp = get_node()->get_parameter("ramp").as_double();
  return true;
}

CallbackReturn FeedforwardController::on_configure(const rclcpp_lifecycle::State &)
{
  if (!read_settings()) {
    return CallbackReturn::FAILURE;
  }
  reference_interfaces_.assign(kReferences * kJoints, kNothing);
  subscription_ = get_node()->create_subscription<Point>(
    "~/reference", rclcpp::SystemDefaultsQoS(),
    [this](const std::shared_ptr<Point> point) { point_.writeFromNonRT(point); });
  return CallbackReturn::SUCCESS;
}

std::vector<hardware_interface::CommandInterface> FeedforwardController::on_export_reference_interfaces()
{
  reference_interfaces_.assign(kReferences * kJoints, kNothing);
  std::vector<hardware_interface::CommandInterface> out;
  out.reserve(reference_interfaces_.size());
  const std::array<const char *, kReferences> kinds{HW_IF_POSITION, HW_IF_VELOCITY, HW_IF_ACCELERATION};
  for (std::size_t k = 0; k < kJoints; ++k) {
    for (std::size_t kind = 0; kind < kReferences; ++kind) {
      out.emplace_back(
        std::string(get_node()->get_name()), joints_[k] + "/" + kinds[kind],
        &reference_interfaces_[kReferences * k + kind]);
    }
  }
  return out;
}

bool FeedforwardController::on_set_chained_mode(bool) { return true; }

void FeedforwardController::read_state(Core::Vector & q, Core::Vector & dq) const
{
  for (std::size_t k = 0; k < kJoints; ++k) {
    q[k] = state_interfaces_[2 * k].get_value();
    dq[k] = state_interfaces_[2 * k + 1].get_value();
  }
}

CallbackReturn FeedforwardController::on_activate(const rclcpp_lifecycle::State &)
{
  Core::Vector q, dq;
  read_state(q, dq);
  for (std::size_t k = 0; k < kJoints; ++k) {  // until somebody says otherwise: stay
    reference_interfaces_[kReferences * k] = q[k];
    reference_interfaces_[kReferences * k + 1] = 0.0;
    reference_interfaces_[kReferences * k + 2] = 0.0;
  }
  point_.writeFromNonRT(nullptr);
  core_.start(settings_);
  return CallbackReturn::SUCCESS;
}

CallbackReturn FeedforwardController::on_deactivate(const rclcpp_lifecycle::State &)
{
  for (auto & command : command_interfaces_) {
    (void)command.set_value(0.0);
  }
  return CallbackReturn::SUCCESS;
}

return_type FeedforwardController::update_reference_from_subscribers(const rclcpp::Time &, const rclcpp::Duration &)
{
  const auto point = *point_.readFromRT();
  if (!point) {
    return return_type::OK;
  }
  if (point->positions.size() != kJoints || point->velocities.size() != kJoints) {
    RCLCPP_WARN_THROTTLE(
      get_node()->get_logger(), *get_node()->get_clock(), 1000, "~/reference: %zu positions and velocities are needed",
      kJoints);
    return return_type::OK;
  }
  const bool bends = point->accelerations.size() == kJoints;
  for (std::size_t k = 0; k < kJoints; ++k) {
    reference_interfaces_[kReferences * k] = point->positions[k];
    reference_interfaces_[kReferences * k + 1] = point->velocities[k];
    reference_interfaces_[kReferences * k + 2] = bends ? point->accelerations[k] : 0.0;
  }
  return return_type::OK;
}

return_type FeedforwardController::update_and_write_commands(
  const rclcpp::Time &, const rclcpp::Duration & period)
{
  Core::Vector q, dq, q_r, dq_r, ddq_r, tau;
  read_state(q, dq);
  for (std::size_t k = 0; k < kJoints; ++k) {
    q_r[k] = reference_interfaces_[kReferences * k];
    dq_r[k] = reference_interfaces_[kReferences * k + 1];
    ddq_r[k] = reference_interfaces_[kReferences * k + 2];
  }
  const Outcome outcome = core_.update(q_r, dq_r, ddq_r, q, dq, period.seconds(), tau);
  for (std::size_t k = 0; k < kJoints; ++k) {
    (void)command_interfaces_[k].set_value(tau[k]);
  }
  if (outcome != Outcome::kFollowing) {
    RCLCPP_WARN_THROTTLE(
      get_node()->get_logger(), *get_node()->get_clock(), 1000, "%s",
      outcome == Outcome::kLimited ? "torque cut to its limit" : "no valid reference or state: holding");
  }
  return return_type::OK;
}

}  // namespace feedforward_controller

PLUGINLIB_EXPORT_CLASS(
  feedforward_controller::FeedforwardController, controller_interface::ChainableControllerInterface)
