#include "dynamics/wind.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace flockstep::dynamics {
namespace {

constexpr double kFootPerMetre = 1.0 / 0.3048;
constexpr double kMinSpeed = 1.0;  // m/s, minimum speed at which the wind carries turbulence

}  // namespace

// dx/dt = -x / T + noise, scaled so that the variance of x is s^2: x(t + d) = e^(-d/T) x(t) + s sqrt(1 - e^(-2d/T)) n.
Wind::Filter Wind::first_order(double std, double time, double step) {
  Filter filter;
  const double keep = std::exp(-step / time);
  filter.keep = static_cast<float>(keep);
  filter.noise = static_cast<float>(std * std::sqrt(1.0 - keep * keep));
  filter.start = static_cast<float>(std);
  return filter;
}

// Two lags in series, dx/dt = (-x + noise) / T and dy/dt = (x - y) / T. The output sqrt(3) x + (1 - sqrt(3)) y is the noise
// filtered by (1 + sqrt(3) T s) / (1 + T s)^2. Its variance is s^2 if (x, y) has the covariance
// P = s^2 [[1/2, 1/4], [1/4, 1/4]]. Over a step d, (x, y) becomes F (x, y) with F = e^(-d/T) [[1, 0], [d/T, 1]], plus noise of
// covariance P - F P F'.
Wind::Filter Wind::second_order(double std, double time, double step) {
  const double decay = std::exp(-step / time);
  const double ratio = step / time;
  const double pxx = 0.5, pxy = 0.25, pyy = 0.25;
  const double qxx = pxx - decay * decay * pxx;
  const double qxy = pxy - decay * decay * (ratio * pxx + pxy);
  const double qyy = pyy - decay * decay * (ratio * ratio * pxx + 2.0 * ratio * pxy + pyy);
  const auto split = [std](double xx, double xy, double yy, float& first, float& shared, float& own) {  // Cholesky
    const double root = std::sqrt(xx);
    first = static_cast<float>(std * root);
    shared = static_cast<float>(std * (xy / root));
    own = static_cast<float>(std * std::sqrt(std::max(yy - xy * xy / xx, 0.0)));
  };
  Filter filter;
  filter.keep = static_cast<float>(decay);
  filter.pass = static_cast<float>(decay * ratio);
  split(qxx, qxy, qyy, filter.noise, filter.shared, filter.own);
  split(pxx, pxy, pyy, filter.start, filter.start_shared, filter.start_own);
  return filter;
}

Wind::Wind(const WindConfig& config, double step)
    : gusts_(config.gusts), mean_(config.mean_mps[0], config.mean_mps[1], config.mean_mps[2]) {
  if (gusts_ == Gusts::ornstein_uhlenbeck) {
    u_ = v_ = w_ = first_order(static_cast<double>(config.gust_std_mps), static_cast<double>(config.gust_time_s), step);
  } else if (gusts_ == Gusts::dryden) {
    const double h = static_cast<double>(config.height_m) * kFootPerMetre;  // ft, the unit of the standard
    const double shape = 0.177 + 0.000823 * h;
    const double length_u = h / std::pow(shape, 1.2) / kFootPerMetre;  // m
    const double length_w = h / kFootPerMetre;
    const double std_w = 0.1 * static_cast<double>(config.wind_at_6m_mps);
    const double std_u = std_w / std::pow(shape, 0.4);
    const Eigen::Vector2d level = mean_.head<2>().cast<double>();
    const double speed = std::max(level.norm(), kMinSpeed);
    if (level.norm() > 0.0) {
      along_ = Vec3(static_cast<float>(level.x() / level.norm()), static_cast<float>(level.y() / level.norm()), 0.0F);
      across_ = Vec3(-along_.y(), along_.x(), 0.0F);
    }
    u_ = first_order(std_u, length_u / speed, step);
    v_ = second_order(std_u, length_u / speed, step);
    w_ = second_order(std_w, length_w / speed, step);
  }
}

GustState Wind::begin(const GustNoise& n) const {
  return {u_.start * n[0], v_.start * n[1], v_.start_shared * n[1] + v_.start_own * n[2], w_.start * n[3],
          w_.start_shared * n[3] + w_.start_own * n[4]};
}

GustState Wind::next(const GustState& g, const GustNoise& n) const {
  return {u_.keep * g[0] + u_.noise * n[0], v_.keep * g[1] + v_.noise * n[1],
          v_.keep * g[2] + v_.pass * g[1] + v_.shared * n[1] + v_.own * n[2], w_.keep * g[3] + w_.noise * n[3],
          w_.keep * g[4] + w_.pass * g[3] + w_.shared * n[3] + w_.own * n[4]};
}

Vec3 Wind::at(const GustState& g) const {
  if (gusts_ == Gusts::none) return mean_;
  if (gusts_ == Gusts::ornstein_uhlenbeck) return mean_ + Vec3(g[0], g[1], g[3]);
  constexpr float kRoot3 = std::numbers::sqrt3_v<float>;
  const float v = kRoot3 * g[1] + (1.0F - kRoot3) * g[2];
  const float w = kRoot3 * g[3] + (1.0F - kRoot3) * g[4];
  return mean_ + g[0] * along_ + v * across_ + w * Vec3::UnitZ();
}

}  // namespace flockstep::dynamics
