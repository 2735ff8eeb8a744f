#include "render/raycast/soft_light.hpp"

#include <cmath>
#include <numbers>

#include "base/random.hpp"

namespace flockstep::render {
namespace {

// The sequence R2, whose points cover a square more evenly than random ones: multiples of the powers of 1 / 1.3247 modulo 1.
// Each pixel shifts it by its own random point.
// Source: M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018.
std::array<std::uint32_t, 2> shifted(const std::array<std::uint32_t, 2>& by, std::size_t number) {
  const auto n = static_cast<std::uint32_t>(number);
  return {by[0] + n * 0xC13FA9A9U, by[1] + n * 0x91E10DA5U};
}

// Points of the unit circle: a table, because the cosine of a vector of floats differs among processors.
constexpr std::size_t kTurns = 1024;
const auto& circle() {
  static const auto points = [] {
    std::array<std::array<float, 2>, kTurns> result;
    for (std::size_t i = 0; i < kTurns; ++i) {
      const double angle = 2.0 * std::numbers::pi * (static_cast<double>(i) + 0.5) / kTurns;
      result[i] = {static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle))};
    }
    return result;
  }();
  return points;
}

// A point of the unit disc, all parts of which are equally likely, and the height of the unit hemisphere above it.
Vec3 on_hemisphere(const std::array<std::uint32_t, 2>& words) {
  const float square = uniform01(words[0]);
  const float radius = std::sqrt(square);
  const auto& turn = circle()[words[1] >> 22U];
  return {radius * turn[0], radius * turn[1], std::sqrt(1.0F - square)};
}

// Returns vector v, given in a frame whose z axis is the unit vector n, in the frame of n.
// Source: T. Duff et al., "Building an orthonormal basis, revisited", JCGT 6(1), 2017.
Vec3 around(const Vec3& n, const Vec3& v) {
  const float sign = std::copysign(1.0F, n.z() + 0.0F);  // -0 is 0: the same surface may have either
  const float a = -1.0F / (sign + n.z());
  const float b = n.x() * n.y() * a;
  return {(1.0F + sign * n.x() * n.x() * a) * v.x() + (b * v.y() + n.x() * v.z()),
          sign * b * v.x() + ((sign + n.y() * n.y() * a) * v.y() + n.y() * v.z()),
          -sign * n.x() * v.x() + (n.z() * v.z() - n.y() * v.y())};
}

void aim(trace::RayBlock& block, std::size_t ray, const Vec3& direction) {
  block.dir_x[ray] = direction.x();
  block.dir_y[ray] = direction.y();
  block.dir_z[ray] = direction.z();
}

}  // namespace

void SoftLight::seed(std::size_t ray, std::size_t column, std::size_t row, std::size_t sample, int ambient_rays) {
  const auto words = philox4x32({static_cast<std::uint32_t>(column), static_cast<std::uint32_t>(row), 0, 0}, {0, 0});
  words_[ray] = {shifted({words[0], words[1]}, sample),
                 shifted({words[2], words[3]}, sample * static_cast<std::size_t>(ambient_rays))};
}

void SoftLight::aim_at_disc(float radius, trace::RayBlock& block) const {
  const Vec3 sun(block.dir_x[0], block.dir_y[0], block.dir_z[0]);
  for (std::size_t i = 0; i < block.count; ++i) {
    const Vec3 point = on_hemisphere(words_[i].sun);
    aim(block, i, around(sun, {radius * point.x(), radius * point.y(), 1.0F}));
  }
}

void SoftLight::aim_at_sky(const float* nx, const float* ny, const float* nz, int number, trace::RayBlock& block) const {
  for (std::size_t i = 0; i < block.count; ++i) {
    const Vec3 point = on_hemisphere(shifted(words_[i].ambient, static_cast<std::size_t>(number)));
    aim(block, i, around({nx[i], ny[i], nz[i]}, point));
  }
}

}  // namespace flockstep::render
