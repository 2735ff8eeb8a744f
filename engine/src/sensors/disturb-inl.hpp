// The loop over values with Gaussian noise and dropouts, such as ranges. Included once per SIMD target.
#if defined(FLOCKSTEP_SENSORS_DISTURB_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef FLOCKSTEP_SENSORS_DISTURB_INL_HPP
#undef FLOCKSTEP_SENSORS_DISTURB_INL_HPP
#else
#define FLOCKSTEP_SENSORS_DISTURB_INL_HPP
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "base/random-inl.hpp"
#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::HWY_NAMESPACE {

// Replaces each value by reading(value, normal, uniform). normal: standard normal, or 0 if no value has noise. uniform: in
// [0, 1), or 1 if no value drops out. Values 2k and 2k + 1 use the k-th of consecutive draws: its first two words for their
// noise, the other two for their dropouts.
template <class F, class Reading>
HWY_INLINE void disturb_each(std::span<float> all, PhiloxInput draw, bool has_noise, bool has_dropout, const Reading& reading) {
  constexpr std::size_t kValues = 2 * F::kCount;  // of a vector of draws
  alignas(64) float normal[kValues] = {}, uniform[kValues], rest[kValues];
  std::fill_n(uniform, kValues, 1.0F);
  for (std::size_t first = 0; first < all.size(); first += kValues) {
    if (has_noise || has_dropout) {
      const auto words = philox_draws<WordsOf<F>>(draw);
      if (has_noise) {
        const NormalPair<F> pair = normal_pair_of<F>(words.a, words.b);
        hn::StoreInterleaved2(pair.first.part[0], pair.second.part[0], typename F::Tag(), normal);
      }
      hn::StoreInterleaved2(uniform_of<F>(words.c).part[0], uniform_of<F>(words.d).part[0], typename F::Tag(), uniform);
      draw.counter[0] += static_cast<std::uint32_t>(F::kCount);
    }
    const std::size_t count = std::min(kValues, all.size() - first);
    float* values = all.data() + first;
    if (count < kValues) {
      std::fill_n(std::copy_n(values, count, rest), kValues - count, std::numeric_limits<float>::infinity());
      values = rest;
    }
    for (std::size_t i = 0; i < kValues; i += F::kCount) {
      reading(F::load_unaligned(values + i), F::load(normal + i), F::load(uniform + i)).store_unaligned(values + i);
    }
    if (count < kValues) std::copy_n(rest, count, all.data() + first);
  }
}

}  // namespace flockstep::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
