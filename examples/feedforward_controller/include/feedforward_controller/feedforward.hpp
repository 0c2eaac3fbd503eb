// Feedforward of an identified model with PD feedback about it. No ROS, no allocation: what runs in the control loop.
#ifndef FEEDFORWARD_CONTROLLER__FEEDFORWARD_HPP_
#define FEEDFORWARD_CONTROLLER__FEEDFORWARD_HPP_

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace feedforward_controller
{

// Functions as `robot_ident export --c` writes them: NAME_torque and NAME_gravity.
using TorqueFunction = void (*)(const double *, const double *, const double *, double *);
using GravityFunction = void (*)(const double *, double *);

enum class Outcome
{
  kFollowing,  // model and feedback, within the limits
  kLimited,    // some joint's torque was cut to its limit
  kHolding     // the reference or the state is not a number: gravity and damping alone
};

// tau = g(q) + s (tau_model(q_r, dq_r, ddq_r) - g(q_r)) + s K_p (q_r - q) + s K_d (dq_r - dq), cut to +- limit.
//
// s rises from 0 to 1 within `ramp` seconds after a start, so that nothing jumps when the controller takes over; the
// arm's weight is carried from the first cycle on. The model is taken at the reference rather than at the measured
// state: measured velocity is noisy, and friction fed forward by its sign would chatter.
template <std::size_t N>
class Feedforward
{
public:
  using Vector = std::array<double, N>;

  struct Settings
  {
    Vector kp{};     // Nm/rad (N/m)
    Vector kd{};     // Nm s/rad (N s/m)
    Vector limit{};  // Nm (N)
    double ramp = 1.0;  // s
  };

  Feedforward(TorqueFunction torque, GravityFunction gravity) : torque_(torque), gravity_(gravity) {}

  // To be called when the controller is activated.
  void start(const Settings & settings)
  {
    settings_ = settings;
    share_ = settings.ramp > 0.0 ? 0.0 : 1.0;
  }

  // Share of model and feedback that is in use [0, 1].
  double share() const { return share_; }

  // One cycle of `period` seconds: fills tau.
  Outcome update(
    const Vector & q_r, const Vector & dq_r, const Vector & ddq_r, const Vector & q, const Vector & dq, double period,
    Vector & tau)
  {
    if (!finite(q) || !finite(dq)) {
      tau.fill(0.0);
      return Outcome::kHolding;
    }
    gravity_(q.data(), tau.data());
    if (!finite(q_r) || !finite(dq_r) || !finite(ddq_r)) {
      share_ = 0.0;
      for (std::size_t k = 0; k < N; ++k) {
        tau[k] -= settings_.kd[k] * dq[k];
      }
      cut(tau);
      return Outcome::kHolding;
    }
    if (settings_.ramp > 0.0) {
      share_ = std::min(1.0, share_ + std::max(0.0, period) / settings_.ramp);
    }
    Vector whole, weight;
    torque_(q_r.data(), dq_r.data(), ddq_r.data(), whole.data());
    gravity_(q_r.data(), weight.data());
    for (std::size_t k = 0; k < N; ++k) {
      const double feedback = settings_.kp[k] * (q_r[k] - q[k]) + settings_.kd[k] * (dq_r[k] - dq[k]);
      tau[k] += share_ * (whole[k] - weight[k] + feedback);
    }
    return cut(tau) ? Outcome::kLimited : Outcome::kFollowing;
  }

private:
  static bool finite(const Vector & x)
  {
    return std::all_of(x.begin(), x.end(), [](double value) { return std::isfinite(value); });
  }

  bool cut(Vector & tau) const
  {
    bool cut_one = false;
    for (std::size_t k = 0; k < N; ++k) {
      const double bounded = std::clamp(tau[k], -settings_.limit[k], settings_.limit[k]);
      cut_one = cut_one || bounded != tau[k];
      tau[k] = bounded;
    }
    return cut_one;
  }

  TorqueFunction torque_;
  GravityFunction gravity_;
  Settings settings_{};
  double share_ = 0.0;
};

}  // namespace feedforward_controller

#endif  // FEEDFORWARD_CONTROLLER__FEEDFORWARD_HPP_
