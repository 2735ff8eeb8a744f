#include "tasks/color_blob.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tasks/color_blob.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "base/wide-inl.hpp"
#include "render/appearance.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::task::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

using Bytes = Wide<hn::ScalableTag<std::uint8_t>>;

// Green is detected by the ratio of G to the larger of R and B, m. Light scales all channels alike, so the ratio hardly depends
// on it. In pixels of the goal, render::kGoalColor, the ratio is about 3, from (26, 120, 38) in full shade to (44, 207, 67) in
// full sun. For white walls, the sky, blue-grey, red and yellow, G is at most the larger of R and B, even with the tint of the
// ambient light. Mixtures of two of these at an edge have a ratio of at most 1.13 (yellow before a blue sky). With a threshold
// of 1.25, a mixed pixel counts if it shows at least 43 % goal before a white wall, or 47 % before a blue-grey pillar. Either
// share changes by 15 % if one of the two is lit and the other in shade. The box is therefore accurate to about half a pixel.
//
// In near darkness rounding would decide the ratio, so the threshold also adds 16. In integers, G > 1.25 m + 16 is equivalent
// to G > m + floor(m / 4) + 16: with m = 4 q + r, 1.25 m is 5 q + r plus a fraction.
constexpr int kRatioShift = 2;
constexpr std::uint8_t kMin = 16;

// Calls mark(channels, first) for each vector of pixels; the last vector may overlap the one before. If the image is smaller
// than a vector, calls mark_one(r, g, b, index) for each pixel instead.
template <class Mark, class MarkOne>
void mark_image(std::span<const std::uint8_t> image, ImageLayout layout, std::size_t pixels, const Mark& mark,
                const MarkOne& mark_one) {
  const bool apart = layout == ImageLayout::chw;
  const auto mark_at = [&](std::size_t first) HWY_ATTR {
    const std::uint8_t* const a = image.data() + first;
    mark(apart ? Wide3<Bytes>::load_unaligned(a, a + pixels, a + 2 * pixels) : Wide3<Bytes>::load_rows(image.data() + 3 * first),
         first);
  };
  std::size_t first = 0;
  for (; first + Bytes::kCount <= pixels; first += Bytes::kCount) mark_at(first);
  if (first > 0 && first < pixels) return mark_at(pixels - Bytes::kCount);  // overlaps the previous vector
  for (; first < pixels; ++first) {
    const auto value = [&](std::size_t channel) -> int { return image[apart ? channel * pixels + first : 3 * first + channel]; };
    mark_one(value(0), value(1), value(2), first);
  }
}

// The larger of two channels times the threshold, rounded down.
HWY_INLINE Bytes ratio_of_larger(Bytes a, Bytes b) {
  const Bytes larger = max(a, b);
  return saturated_add(larger, shift_right<kRatioShift>(larger));
}

HWY_INLINE void store_marks(Bytes::Mask marks, std::uint8_t* to) { value_if(marks, Bytes(255)).store_unaligned(to); }

// Fills mask, (pixels,): 255 for a green pixel, else 0.
void mark_green(std::span<const std::uint8_t> rgb, ImageLayout layout, std::span<std::uint8_t> mask) {
  mark_image(
      rgb, layout, mask.size(),
      [&](const Wide3<Bytes>& pixel, std::size_t first)
          HWY_ATTR { store_marks(pixel.y > saturated_add(ratio_of_larger(pixel.x, pixel.z), kMin), mask.data() + first); },
      [&](int red, int green, int blue, std::size_t at) {
        const int larger = std::max(red, blue);
        mask[at] = green > larger + (larger >> kRatioShift) + kMin ? 255 : 0;
      });
}

// Fills mask, (pixels,): 255 if each channel is in its range, else 0. The image is in hsv for ColorSpace::hsv, otherwise in
// rgb.
void mark_range(std::span<const std::uint8_t> image, ImageLayout layout, const ColorRange& range, std::span<std::uint8_t> mask) {
  const bool excess = range.space == ColorSpace::excess;
  // If the hue range wraps around, mark the hues outside the gap.
  const bool wraps = range.space == ColorSpace::hsv && range.low[0] > range.high[0];
  const auto bound = [](int value) { return static_cast<std::uint8_t>(value); };
  const std::array<std::uint8_t, 3> low{bound(wraps ? range.high[0] + 1 : range.low[0]), bound(range.low[1]),
                                        bound(range.low[2])};
  const std::array<std::uint8_t, 3> high{bound(wraps ? range.low[0] - 1 : range.high[0]), bound(range.high[1]),
                                         bound(range.high[2])};
  mark_image(
      image, layout, mask.size(),
      [&](Wide3<Bytes> pixel, std::size_t first) HWY_ATTR {
        if (excess) {
          const auto& [red, green, blue] = pixel;
          pixel = {saturated_sub(red, ratio_of_larger(green, blue)), saturated_sub(green, ratio_of_larger(red, blue)),
                   saturated_sub(blue, ratio_of_larger(red, green))};
        }
        const auto is_in = [&](Bytes value, std::size_t k) HWY_ATTR { return ~((low[k] > value) | (value > high[k])); };
        const Bytes::Mask hue = is_in(pixel.x, 0);
        store_marks((wraps ? ~hue : hue) & is_in(pixel.y, 1) & is_in(pixel.z, 2), mask.data() + first);
      },
      [&](int a, int b, int c, std::size_t at) {
        if (excess) {
          const auto over = [](int value, int x, int y) {
            const int larger = std::max(x, y);
            return std::max(value - larger - (larger >> kRatioShift), 0);
          };
          const int red = over(a, b, c), green = over(b, a, c), blue = over(c, a, b);
          a = red;
          b = green;
          c = blue;
        }
        const auto is_in = [&](int value, std::size_t k) { return value >= low[k] && value <= high[k]; };
        mask[at] = (is_in(a, 0) != wraps) && is_in(b, 1) && is_in(c, 2) ? 255 : 0;
      });
}

}  // namespace flockstep::task::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::task {
namespace {

// The figures above depend on the colours of the markers: with a gamma of 2.2, a pixel ratio of 3 is 3^2.2 = 11.2 in linear
// light.
constexpr float green_ratio(const std::array<float, 3>& color) { return color[1] / std::max(color[0], color[2]); }
static_assert(green_ratio(render::kGoalColor) > 11.2F, "the goal is clearly green");
static_assert(green_ratio(render::kStartColor) < 1.0F && green_ratio(render::kWaypointColor) < 1.0F, "no other marker is");

bool any(std::span<const std::uint8_t> marks) {
  std::uint8_t found = 0;
  for (const std::uint8_t mark : marks) found |= mark;
  return found != 0;
}

}  // namespace

HWY_EXPORT(mark_green);
HWY_EXPORT(mark_range);

ColorBlob find_color(std::span<const std::uint8_t> rgb, int width_px, int height_px, ImageLayout layout, const ColorRange& range,
                     ColorBlobScratch& scratch) {
  const auto width = static_cast<std::size_t>(width_px);
  const auto height = static_cast<std::size_t>(height_px);
  assert(rgb.size() == 3 * width * height);
  scratch.mask.resize(width * height);
  if (range == ColorRange()) {
    HWY_DYNAMIC_DISPATCH(mark_green)(rgb, layout, scratch.mask);
  } else {
    std::span<const std::uint8_t> image = rgb;
    if (range.space == ColorSpace::hsv) {
      scratch.hsv.resize(rgb.size());
      imaging::rgb_to_hsv(rgb.data(), width_px, height_px, layout, scratch.hsv.data(), scratch.conversion);
      image = scratch.hsv;
    }
    HWY_DYNAMIC_DISPATCH(mark_range)(image, layout, range, scratch.mask);
  }

  const auto row = [&](std::size_t y) { return std::span<const std::uint8_t>(scratch.mask).subspan(y * width, width); };
  std::size_t top = 0;
  std::size_t bottom = height;  // one past the last row
  while (top < height && !any(row(top))) ++top;
  if (top == height) return {};
  while (!any(row(bottom - 1))) --bottom;
  scratch.columns.assign(width, 0);
  for (std::size_t y = top; y < bottom; ++y) {
    std::ranges::transform(row(y), scratch.columns, scratch.columns.begin(), std::bit_or<std::uint8_t>());
  }
  const auto is_marked = [](std::uint8_t mark) { return mark != 0; };
  const auto left = std::ranges::find_if(scratch.columns, is_marked) - scratch.columns.begin();
  const auto right = scratch.columns.rend() - std::find_if(scratch.columns.rbegin(), scratch.columns.rend(), is_marked);

  ColorBlob blob;
  blob.found = true;
  blob.x = static_cast<int>(left);
  blob.y = static_cast<int>(top);
  blob.width = static_cast<int>(right - left);
  blob.height = static_cast<int>(bottom - top);
  // Twice the centre is an integer, so a centred box gives exactly 0.
  blob.offset = static_cast<float>(2 * blob.x + blob.width - width_px) / static_cast<float>(width_px);
  blob.area = static_cast<float>(static_cast<std::size_t>(blob.width) * static_cast<std::size_t>(blob.height)) /
              static_cast<float>(width * height);
  return blob;
}

}  // namespace flockstep::task
#endif
