#include "sensors/color_errors.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sensors/color_errors.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/random-inl.hpp"
#include "base/srgb.hpp"
#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::sensors::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

// Adds noise to light and writes the sRGB values of its levels. The lists of numbers are whole vectors.
void write_colors(const ColorErrors& errors, const std::vector<std::uint8_t>& levels, std::span<const float> light,
                  std::span<const float> normal, std::size_t count, std::uint8_t* values) {
  using F = WideUpTo<16>;
  using I = typename F::Int;
  const auto last = static_cast<float>(levels.size() - 1);
  const float shot = errors.shot_noise * errors.shot_noise, read = errors.read_noise * errors.read_noise;
  std::int32_t level[F::kCount];
  for (std::size_t first = 0; first < count; first += F::kCount) {
    const F exact = F::load_unaligned(light.data() + first);
    const F noisy = exact + sqrt(shot * exact + read) * F::load_unaligned(normal.data() + first);
    convert<I>(round(min(max(noisy, F(0.0F)), F(1.0F)) * last)).store_unaligned(level);
    for (std::size_t i = 0; i < std::min(F::kCount, count - first); ++i) {
      values[first + i] = levels[static_cast<std::size_t>(level[i])];
    }
  }
}

void disturb_colors(const ColorErrors& errors, float exposure, const std::vector<std::uint8_t>& levels,
                    const render::CameraOptics& camera, const ColorImage& image, const PhiloxInput& draw, ColorScratch& scratch) {
  const std::array<float, 256>& linear = srgb_to_linear();
  const bool has_noise = errors.shot_noise > 0.0F || errors.read_noise > 0.0F;
  const std::size_t count = image.width * image.channels;  // values of a row of a plane
  PhiloxInput next = draw;
  std::uint8_t* values = image.values;
  for (std::size_t row = 0; row < image.planes * image.height; ++row) {
    const float z = (camera.cy - static_cast<float>(row % image.height) - 0.5F) / camera.fy;
    float* light = scratch.light.data();
    for (std::size_t u = 0; u < image.width; ++u) {
      const float y = (camera.cx - static_cast<float>(u) - 0.5F) / camera.fx;
      const float cosine_2 = 1.0F / (1.0F + y * y + z * z);
      const float gain = exposure * (1.0F - errors.vignetting * (1.0F - cosine_2 * cosine_2));
      for (std::size_t c = 0; c < image.channels; ++c) *light++ = linear[values[u * image.channels + c]] * gain;
    }
    if (has_noise) {
      write_normals<WideUpTo<16>>(next, std::span(scratch.normal).first(count));
      next.counter[0] += static_cast<std::uint32_t>((count + 3) / 4);
    }
    write_colors(errors, levels, scratch.light, scratch.normal, count, values);
    values += count;
  }
}

}  // namespace flockstep::sensors::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::sensors {

std::vector<std::uint8_t> make_levels(const ColorErrors& errors) {
  std::vector<std::uint8_t> levels(4096);
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const double light = static_cast<double>(i) / static_cast<double>(levels.size() - 1);
    const double srgb = light <= 0.0031308 ? 12.92 * light : 1.055 * std::pow(light, 1.0 / 2.4) - 0.055;
    levels[i] = static_cast<std::uint8_t>(std::lround(255.0 * std::pow(srgb, static_cast<double>(errors.gamma))));
  }
  return levels;
}

HWY_EXPORT(disturb_colors);

void add_color_errors(const ColorErrors& errors, const std::vector<std::uint8_t>& levels, const render::CameraOptics& camera,
                      const ColorImage& image, const PhiloxInput& draw, ColorScratch& scratch) {
  constexpr std::size_t kPadding = 16;  // at least a vector
  scratch.light.resize(image.width * image.channels + kPadding);
  scratch.normal.resize(scratch.light.size());
  float exposure = errors.exposure;
  if (errors.auto_exposure) {
    const std::size_t count = image.width * image.height * image.planes * image.channels;
    double sum = 0.0;
    for (std::size_t i = 0; i < count; ++i) sum += static_cast<double>(srgb_to_linear()[image.values[i]]);
    if (sum > 0.0) exposure *= static_cast<float>(static_cast<double>(*errors.auto_exposure) * static_cast<double>(count) / sum);
  }
  HWY_DYNAMIC_DISPATCH(disturb_colors)(errors, exposure, levels, camera, image, draw, scratch);
}

}  // namespace flockstep::sensors
#endif
