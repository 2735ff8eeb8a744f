#include "generators/swatches.hpp"

#include <algorithm>
#include <cmath>

#include "generators/noise.hpp"

namespace flockstep::indoors {
namespace {

constexpr int kSwatchPx = 512;
constexpr int kColumnPx = 16, kRampPx = 64;  // px, size of a colour's column
constexpr int kCellPx = 64;                  // px, grid of the patches
constexpr double kDarkestShade = 0.2;        // brightness at the lower end of a column, relative to its colour

constexpr std::array<Color, kSwatchColors> kRampColors{{
    {0.80F, 0.80F, 0.78F},   // white
    {0.66F, 0.60F, 0.48F},   // cream
    {0.48F, 0.49F, 0.50F},   // light grey
    {0.24F, 0.25F, 0.26F},   // grey
    {0.08F, 0.085F, 0.09F},  // dark grey
    {0.02F, 0.02F, 0.023F},  // black
    {0.36F, 0.39F, 0.42F},   // steel
    {0.03F, 0.06F, 0.17F},   // navy
    {0.04F, 0.17F, 0.46F},   // blue
    {0.05F, 0.26F, 0.27F},   // teal
    {0.11F, 0.30F, 0.05F},   // leaf
    {0.04F, 0.14F, 0.03F},   // moss
    {0.50F, 0.05F, 0.04F},   // red
    {0.42F, 0.14F, 0.06F},   // rust
    {0.75F, 0.24F, 0.03F},   // orange
    {0.80F, 0.52F, 0.03F},   // yellow
    {0.52F, 0.42F, 0.28F},   // sand
    {0.15F, 0.08F, 0.045F},  // brown
    {0.20F, 0.06F, 0.16F},   // plum
}};

// Positions on the patch grid: left column, top row, width in columns, height in rows.
struct SwatchPatch {
  Swatch swatch;
  int column, row, columns, rows;
  double width_m;
};
constexpr std::array<SwatchPatch, static_cast<int>(Swatch::count) - kSwatchColors> kSwatchPatches{{
    {Swatch::oak, 0, 1, 4, 2, 2.4},          {Swatch::walnut, 4, 1, 4, 2, 2.4},     {Swatch::fabric, 0, 3, 1, 1, 0.5},
    {Swatch::planks, 1, 3, 1, 1, 1.2},       {Swatch::carton, 0, 4, 2, 1, 0.0},     {Swatch::carton_top, 2, 4, 1, 1, 0.0},
    {Swatch::carton_plain, 3, 4, 1, 1, 0.0}, {Swatch::wrapped, 2, 3, 2, 1, 0.0},    {Swatch::keyboard, 0, 5, 1, 1, 0.0},
    {Swatch::desktop, 4, 3, 2, 1, 0.0},      {Swatch::code, 4, 4, 2, 1, 0.0},       {Swatch::slides, 6, 3, 2, 1, 0.0},
    {Swatch::whiteboard, 6, 4, 2, 1, 0.0},   {Swatch::rug, 0, 6, 2, 2, 0.0},        {Swatch::stripes, 1, 5, 1, 1, 0.0},
    {Swatch::painting_a, 2, 5, 2, 2, 0.0},   {Swatch::painting_b, 4, 5, 2, 2, 0.0}, {Swatch::painting_c, 6, 5, 2, 2, 0.0},
    {Swatch::painting_d, 2, 7, 2, 1, 0.0},   {Swatch::painting_e, 4, 7, 2, 1, 0.0},
}};

bool is_within(double s, double t, double left, double top, double right, double bottom) {
  return s >= left && s < right && t >= top && t < bottom;
}

class SwatchPainter {
 public:
  SwatchPainter(std::uint32_t purpose, std::uint64_t seed) : noise_(purpose, seed, 900) {}

  // x and y are pixels of the image. s and t in [0, 1) are coordinates within the patch.
  Color at(Swatch swatch, double x, double y, double s, double t) const {
    switch (swatch) {
      case Swatch::oak:
        return wood(x, y, {0.33F, 0.20F, 0.10F}, {0.56F, 0.39F, 0.22F});
      case Swatch::walnut:
        return wood(x, y, {0.085F, 0.042F, 0.022F}, {0.23F, 0.125F, 0.065F});
      case Swatch::planks:
        return mixed(wood(x, y, {0.30F, 0.20F, 0.11F}, {0.50F, 0.37F, 0.22F}), {0.10F, 0.07F, 0.04F},
                     std::fmod(4.0 * t, 1.0) < 0.08 ? 0.8 : 0.0);
      case Swatch::fabric:
        return mixed(Color{0.20F, 0.22F, 0.25F}, Color{0.30F, 0.32F, 0.36F}, noise_.octaves(x / 2.0, y / 2.0, 2));
      case Swatch::carton:
        return carton(x, y, s, t, 2.0);
      case Swatch::carton_top:
        return mixed(board(x, y), {0.55F, 0.47F, 0.34F}, std::abs(t - 0.5) < 0.07 ? 0.8 : 0.0);
      case Swatch::carton_plain:
        return board(x, y);
      case Swatch::wrapped:
        return wrapped(x, y, s, t);
      case Swatch::keyboard: {
        const bool is_gap = std::fmod(15.0 * s, 1.0) < 0.2 || std::fmod(5.0 * t, 1.0) < 0.2;
        return is_gap ? Color{0.015F, 0.015F, 0.015F} : Color{0.10F, 0.10F, 0.11F};
      }
      case Swatch::desktop:
        return desktop(x, y, s, t);
      case Swatch::code:
        return code(s, t);
      case Swatch::slides:
        return slides(s, t);
      case Swatch::whiteboard:
        return whiteboard(s, t);
      case Swatch::rug:
        return rug(x, y, s, t);
      case Swatch::stripes:
        return std::fmod(2.0 * (s + t), 1.0) < 0.5 ? Color{0.80F, 0.55F, 0.02F} : Color{0.02F, 0.02F, 0.02F};
      case Swatch::painting_a: {  // hills at dusk
        const double far = 0.55 + 0.12 * noise_.at(5.0 * s, 1.0), near = 0.72 + 0.16 * noise_.at(3.0 * s, 7.0);
        const Color sky = mixed(Color{0.08F, 0.16F, 0.32F}, Color{0.80F, 0.42F, 0.18F}, std::min(1.0, t / far));
        return t > near ? Color{0.03F, 0.06F, 0.06F} : t > far ? Color{0.10F, 0.16F, 0.22F} : sky;
      }
      case Swatch::painting_b: {  // discs and bars
        const double u = s - 0.4, v = t - 0.42;
        if (u * u + v * v < 0.05) return {0.70F, 0.20F, 0.05F};
        if (is_within(s, t, 0.5, 0.1, 0.62, 0.9)) return {0.04F, 0.14F, 0.22F};
        if (is_within(s, t, 0.1, 0.66, 0.9, 0.74)) return {0.75F, 0.52F, 0.08F};
        return {0.72F, 0.68F, 0.58F};
      }
      case Swatch::painting_c: {  // washes of colour
        const double bands = noise_.octaves(2.5 * s, 6.0 * t + 3.0 * noise_.at(2.0 * s, 40.0), 3);
        return mixed(Color{0.02F, 0.14F, 0.20F}, Color{0.78F, 0.74F, 0.62F}, std::clamp(2.4 * bands - 0.7, 0.0, 1.0));
      }
      case Swatch::painting_d: {  // mountains over a lake
        const double ridge = 0.55 - 0.42 * noise_.octaves(5.0 * s, 60.0, 3), haze = 0.6 - 0.2 * noise_.octaves(9.0 * s, 70.0, 2);
        if (t > 0.68) return mixed(Color{0.10F, 0.22F, 0.26F}, Color{0.22F, 0.36F, 0.38F}, noise_.at(3.0 * s, 40.0 * t));
        if (t > haze) return {0.07F, 0.13F, 0.09F};
        if (t > ridge) return t < 0.36 ? Color{0.80F, 0.80F, 0.80F} : Color{0.22F, 0.25F, 0.30F};
        return mixed(Color{0.25F, 0.42F, 0.60F}, Color{0.70F, 0.70F, 0.64F}, 1.6 * t);
      }
      case Swatch::painting_e: {  // fields between lines
        const double column = std::floor(4.0 * s), row = std::floor(2.0 * t);
        if (std::fmod(4.0 * s, 1.0) < 0.05 || std::fmod(2.0 * t, 1.0) < 0.05) return {0.02F, 0.02F, 0.02F};
        const double hue = noise_.at(column, row + 80.0);
        return hue < 0.25   ? Color{0.55F, 0.06F, 0.04F}
               : hue < 0.45 ? Color{0.03F, 0.09F, 0.35F}
               : hue < 0.6  ? Color{0.78F, 0.55F, 0.04F}
                            : Color{0.76F, 0.75F, 0.70F};
      }
      default:
        return {1.0F, 0.0F, 1.0F};
    }
  }

 private:
  Color wood(double x, double y, const Color& dark, const Color& bright) const {
    const double bend = 1.5 * noise_.at(x / 80.0, y / 40.0);
    const double broad = noise_.at(x / 120.0, y / 14.0 + bend), fine = noise_.octaves(x / 40.0, y / 2.5 + 3.0 * bend, 2);
    return mixed(dark, bright, std::clamp(0.15 + 0.35 * broad + 0.45 * fine, 0.0, 1.0));
  }

  Color board(double x, double y) const {
    return mixed(Color{0.32F, 0.205F, 0.11F}, Color{0.42F, 0.28F, 0.155F}, noise_.octaves(x / 20.0, y / 6.0, 2));
  }

  Color carton(double x, double y, double s, double t, double wide) const {
    const double u = std::fmod(wide * s, 1.0);  // two cartons side by side
    Color color = board(x, y);
    if (u < 0.02 || t < 0.03) color = mixed(color, {0.05F, 0.03F, 0.02F}, 0.75);
    if (std::abs(u - 0.5) < 0.05) color = mixed(color, {0.56F, 0.48F, 0.35F}, 0.75);
    if (is_within(u, t, 0.64, 0.5, 0.9, 0.8)) {
      const bool is_bar = is_within(u, t, 0.67, 0.62, 0.87, 0.76) && std::fmod(u * 37.0, 1.0) < 0.5;
      color = is_bar ? Color{0.04F, 0.04F, 0.04F} : Color{0.74F, 0.74F, 0.70F};
    }
    return color;
  }

  // Four shrink-wrapped cartons.
  Color wrapped(double x, double y, double s, double t) const {
    const double u = std::fmod(2.0 * s, 1.0), v = std::fmod(2.0 * t, 1.0);
    Color color = board(x, y);
    if (u < 0.04 || v < 0.06) color = mixed(color, {0.05F, 0.03F, 0.02F}, 0.7);
    const double shine = noise_.octaves(x / 5.0 + y / 9.0, y / 30.0, 2);
    return mixed(color, {0.62F, 0.66F, 0.70F}, 0.25 + 0.45 * std::clamp(2.5 * shine - 1.2, 0.0, 1.0));
  }

  Color desktop(double x, double y, double s, double t) const {
    if (t > 0.93) return {0.02F, 0.03F, 0.05F};
    if (is_within(s, t, 0.08, 0.1, 0.62, 0.8)) {
      if (t < 0.17) return {0.10F, 0.22F, 0.42F};
      const bool is_text = std::fmod(12.0 * t, 1.0) < 0.45 && s > 0.12 && s < 0.3 + 0.28 * noise_.at(std::floor(12.0 * t), 3.0);
      return is_text ? Color{0.25F, 0.27F, 0.3F} : Color{0.88F, 0.89F, 0.9F};
    }
    if (is_within(s, t, 0.55, 0.3, 0.94, 0.86)) return t < 0.36 ? Color{0.1F, 0.3F, 0.2F} : Color{0.7F, 0.75F, 0.8F};
    return mixed(Color{0.02F, 0.16F, 0.36F}, Color{0.10F, 0.50F, 0.62F}, noise_.octaves(x / 40.0, y / 40.0, 2));
  }

  Color code(double s, double t) const {
    const double line = std::floor(16.0 * t);
    const double indent = 0.05 + 0.05 * std::floor(4.0 * noise_.at(line + 0.5, 11.0));
    const double end = indent + 0.12 + 0.5 * noise_.at(line + 0.5, 23.0);
    if (std::fmod(16.0 * t, 1.0) > 0.5 || s < indent || s > end) return {0.012F, 0.016F, 0.024F};
    const double hue = noise_.at(8.0 * s, line);
    return hue < 0.4 ? Color{0.25F, 0.5F, 0.75F} : hue < 0.6 ? Color{0.6F, 0.4F, 0.15F} : Color{0.5F, 0.55F, 0.55F};
  }

  Color slides(double s, double t) const {
    if (t < 0.2) return is_within(s, t, 0.06, 0.08, 0.55, 0.14) ? Color{0.85F, 0.85F, 0.85F} : Color{0.03F, 0.12F, 0.3F};
    const double bar = std::floor(9.0 * (s - 0.08));
    if (s > 0.08 && s < 0.52 && std::fmod(9.0 * (s - 0.08), 1.0) < 0.6 && t < 0.9 && t > 0.85 - 0.15 * bar) {
      return {0.08F, 0.35F, 0.6F};
    }
    const double u = s - 0.76, v = 0.5 * (t - 0.56);
    if (u * u + v * v < 0.022) return u > 0.0 && v < 0.0 ? Color{0.8F, 0.35F, 0.05F} : Color{0.1F, 0.45F, 0.45F};
    return {0.86F, 0.87F, 0.88F};
  }

  Color whiteboard(double s, double t) const {
    const auto stroke = [&](double left, double right, double middle, double swing, double number) {
      return s > left && s < right && std::abs(t - middle - swing * (noise_.at(9.0 * s, number) - 0.5)) < 0.014;
    };
    if (stroke(0.08, 0.4, 0.2, 0.05, 1) || stroke(0.08, 0.34, 0.32, 0.05, 2) || stroke(0.08, 0.38, 0.44, 0.05, 3)) {
      return {0.03F, 0.06F, 0.3F};
    }
    if (stroke(0.52, 0.92, 0.7 - 0.5 * (s - 0.52), 0.25, 4)) return {0.5F, 0.05F, 0.04F};
    const bool is_axis = is_within(s, t, 0.5, 0.2, 0.507, 0.86) || is_within(s, t, 0.5, 0.845, 0.94, 0.86);
    if (is_axis || stroke(0.1, 0.36, 0.7, 0.2, 5)) return {0.03F, 0.03F, 0.03F};
    return {0.86F, 0.87F, 0.88F};
  }

  Color rug(double x, double y, double s, double t) const {
    const double border = std::min({s, t, 1.0 - s, 1.0 - t});
    const double wool = noise_.octaves(x / 2.0, y / 2.0, 2);
    const bool is_line = (border > 0.06 && border < 0.09) || (border > 0.13 && border < 0.145);
    const Color field = border < 0.06 || is_line ? Color{0.42F, 0.36F, 0.27F} : Color{0.09F, 0.12F, 0.17F};
    const double diamond = std::fmod(6.0 * s + 6.0 * t, 1.0) * std::fmod(6.0 * s - 6.0 * t + 6.0, 1.0);
    const Color color = border > 0.145 && diamond < 0.05 ? Color{0.30F, 0.27F, 0.22F} : field;
    return mixed(mixed(color, {0.0F, 0.0F, 0.0F}, 0.3), color, wool);
  }

  Noise noise_;
};

}  // namespace

SwatchArea area(Swatch swatch) {
  const auto number = static_cast<int>(swatch);
  if (number < kSwatchColors) {
    const double s = (kColumnPx * number + 0.5 * kColumnPx) / kSwatchPx;
    return {{s, 1.0 / kSwatchPx}, {s, (kRampPx - 1.0) / kSwatchPx}, 0.0};
  }
  const SwatchPatch& patch = kSwatchPatches[static_cast<std::size_t>(number - kSwatchColors)];
  constexpr double kInset = 1.0;  // px, keeps neighbouring patches from bleeding in
  return {{(kCellPx * patch.column + kInset) / kSwatchPx, (kCellPx * patch.row + kInset) / kSwatchPx},
          {(kCellPx * (patch.column + patch.columns) - kInset) / kSwatchPx,
           (kCellPx * (patch.row + patch.rows) - kInset) / kSwatchPx},
          patch.width_m};
}

std::uint16_t swatch_texture(WorldBuilder& builder, std::uint32_t purpose, std::uint64_t seed) {
  const SwatchPainter painter(purpose, seed);
  return builder.texture("swatches", kSwatchPx, kSwatchPx, [&](float s, float t) -> Color {
    const double x = kSwatchPx * static_cast<double>(s), y = kSwatchPx * static_cast<double>(t);
    if (y < kRampPx) {
      const auto column = static_cast<std::size_t>(x / kColumnPx);
      if (column >= kRampColors.size()) return {0.0F, 0.0F, 0.0F};
      return mixed(Color{0.0F, 0.0F, 0.0F}, kRampColors[column], mixed(1.0, kDarkestShade, y / kRampPx));
    }
    const auto column = static_cast<int>(x / kCellPx), row = static_cast<int>(y / kCellPx);
    for (const SwatchPatch& patch : kSwatchPatches) {
      if (column < patch.column || column >= patch.column + patch.columns || row < patch.row || row >= patch.row + patch.rows) {
        continue;
      }
      return painter.at(patch.swatch, x, y, (x / kCellPx - patch.column) / patch.columns, (y / kCellPx - patch.row) / patch.rows);
    }
    return {0.0F, 0.0F, 0.0F};
  });
}

}  // namespace flockstep::indoors
