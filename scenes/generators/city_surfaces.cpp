#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "generators/city_parts.hpp"
#include "generators/noise.hpp"
#include "planning/draws.hpp"

namespace flockstep::streets {
namespace {

// Semantic classes that cameras report. Several materials share a class.
enum class Kind : std::uint16_t {
  road = 1,
  pavement,
  grass,
  building,
  roof,
  glass,
  car,
  pole,
  trunk,
  tree,
  furniture,
  awning,
  cable,
  sign,
  water
};

constexpr Color kWhite{1.0F, 1.0F, 1.0F};

Color scaled(const Color& color, double factor) {
  const auto f = static_cast<float>(factor);
  return {f * color[0], f * color[1], f * color[2]};
}

// Triangle wave of period 1, from 1 down to 0 and back.
double wave(double x) { return std::abs(2.0 * (x - std::floor(x)) - 1.0); }

class Painter {
  static constexpr int kTile = 256;  // px, side of the noise tile
  static constexpr int kSpots = 64;

 public:
  Painter(WorldBuilder& builder, std::uint64_t seed) : builder_(builder) {
    const Noise noise(Draws::kCity, seed, 1);
    for (int row = 0; row < kTile; ++row) {
      for (int column = 0; column < kTile; ++column) {
        const double x = static_cast<double>(column) / kTile, y = static_cast<double>(row) / kTile;
        fine_.push_back(noise.octaves(64.0 * x, 64.0 * y, 2, 64));
        coarse_.push_back(noise.octaves(5.0 * x, 5.0 * y, 4, 5));
      }
    }
    Draws draws(Draws::kCity, seed, 1U << 20U);
    for (int i = 0; i < kSpots * kSpots; ++i) spots_.push_back(draws.uniform(0.0, 1.0));
  }

  // color(s, t) takes s and t in [0, 1).
  template <class ColorAt>
  std::uint16_t textured(const std::string& name, Kind kind, int width, int height, const ColorAt& color) {
    const std::uint16_t texture = builder_.texture(
        name, width, height, [&](float s, float t) { return color(static_cast<double>(s), static_cast<double>(t)); });
    return builder_.material({name, kWhite, static_cast<std::uint16_t>(kind), texture});
  }

  std::uint16_t plain(const std::string& name, Kind kind, const Color& color) {
    return builder_.material({name, color, static_cast<std::uint16_t>(kind), std::nullopt});
  }

  // Noise in [0, 1) that repeats `times` times across the texture.
  double fine(double s, double t, double times = 1.0) const { return in(fine_, s * times, t * times); }
  double coarse(double s, double t, double times = 1.0) const { return in(coarse_, s * times, t * times); }
  // A random value per pair of integers.
  double spot(int i, int j) const { return spots_[static_cast<std::size_t>((i & 63) * kSpots + (j & 63))]; }

 private:
  static double in(const std::vector<double>& tile, double s, double t) {
    const auto pixel = [](double x) { return static_cast<std::size_t>((x - std::floor(x)) * kTile) % kTile; };
    return tile[pixel(t) * kTile + pixel(s)];
  }

  WorldBuilder& builder_;
  std::vector<double> fine_, coarse_, spots_;
};

bool within(double x, double low, double high) { return x >= low && x < high; }

// Returns the colour of a glass pane: a reflection of the sky over a lit room, curtains or a blind. u and v are in [0, 1], v
// points up, and `which` is the number of the window.
Color pane(const Painter& painter, double u, double v, int which) {
  const double luck = painter.spot(which, 1), more = painter.spot(which, 2);
  const double cloud = painter.coarse(0.31 * which + 0.25 * u, 0.17 * which - 0.35 * v);
  const double sky = std::clamp(1.6 * (v + 0.5 * (cloud - 0.5) + 0.25 * u) - 0.55, 0.0, 1.0);
  Color glass = mixed(Color{0.022F, 0.028F, 0.035F}, Color{0.16F, 0.24F, 0.35F}, 0.75 * sky);
  if (luck < 0.1) {  // lit room
    const double lamp = std::clamp(1.3 - 2.2 * std::abs(u - 0.2 - 0.6 * more) - 0.7 * std::abs(v - 0.75), 0.25, 1.0);
    glass = mixed(glass, Color{0.72F, 0.46F, 0.19F}, 0.85 * lamp);
  } else if (luck < 0.36) {  // curtains
    const double open = 0.16 + 0.2 * more;
    if (u < open || u > 1.0 - open) {
      const double fold = wave(14.0 * u + more);
      glass = mixed(scaled(Color{0.34F, 0.32F, 0.29F}, 0.7 + 0.3 * fold), glass, 0.25);
    }
  } else if (luck < 0.56 && v > 0.25 + 0.6 * more) {  // blind
    glass = scaled(Color{0.36F, 0.345F, 0.31F}, 0.8 + 0.2 * wave(18.0 * v));
  }
  return glass;
}

// Returns the colour of a window in a wall: a shaded reveal, a frame and glass panes. (x, y) is in m from the lower left
// corner.
Color window(const Painter& painter, double x, double y, double width, double height, int across, int down, const Color& frame,
             int which) {
  constexpr double kReveal = 0.1, kFrame = 0.055;
  const double inner_width = width - kReveal, inner_height = height - kReveal;
  if (y > inner_height || x > inner_width) return Color{0.1F, 0.095F, 0.09F};  // reveal, on the side away from the sun
  const double u = x / inner_width, v = y / inner_height;
  const auto bar = [](double at, double length, int count) {
    const double pitch = length / count, rest = at - pitch * std::floor(at / pitch);
    return std::min(rest, pitch - rest);
  };
  const bool is_bar = bar(x, inner_width, across) < 0.5 * kFrame || bar(y, inner_height, down) < 0.5 * kFrame ||
                      std::min(x, inner_width - x) < kFrame || std::min(y, inner_height - y) < kFrame;
  if (is_bar) return frame;
  const double shade = y > inner_height - 0.3 ? 0.65 : 1.0;  // shadow of the lintel
  return scaled(pane(painter, u, v, which), shade);
}

// x, y: m within a bay, y up from its floor; s, t: texture coordinates; which: number of the bay.
struct Spot {
  double x, y, s, t;
  int which;
};

template <class ColorAt>
auto bays(double bay_m, double floor_m, int floors, const ColorAt& color) {
  return [=](double s, double t) {
    const double column = std::floor(4.0 * s), row = std::floor(floors * t);
    return color(Spot{(4.0 * s - column) * bay_m, (1.0 - (floors * t - row)) * floor_m, s, t,
                      static_cast<int>(column) + 4 * static_cast<int>(row)});
  };
}

Color bricks(const Painter& painter, double s, double t, int across, int down) {
  const auto row = static_cast<int>(std::floor(t * down));
  const double along = s * across + 0.5 * (row % 2);
  const auto column = static_cast<int>(std::floor(along)) % across;
  const double u = along - std::floor(along), v = t * down - row;
  if (u < 0.07 || v < 0.2) return scaled(Color{0.34F, 0.30F, 0.26F}, 0.85 + 0.2 * painter.fine(s, t));
  const double tone = painter.spot(column, row);
  const Color brick = mixed(Color{0.30F, 0.105F, 0.062F}, Color{0.44F, 0.185F, 0.105F}, tone);
  return scaled(brick, 0.8 + 0.3 * painter.fine(s, t) + 0.15 * (painter.coarse(s, t) - 0.5));
}

// Stains left by rain.
double streaks(const Painter& painter, double s, double t) {
  return 0.9 + 0.14 * painter.coarse(6.0 * s, 0.5 * t) + 0.1 * (painter.coarse(s, t) - 0.5);
}

Color plastered(const Painter& painter, double s, double t) {
  return scaled(Color{0.72F, 0.70F, 0.66F}, streaks(painter, s, t) * (0.96 + 0.06 * painter.fine(s, t)));
}

Color ashlar(const Painter& painter, double s, double t, int across, int down) {
  const auto row = static_cast<int>(std::floor(t * down));
  const double along = s * across + 0.5 * (row % 2);
  const double u = along - std::floor(along), v = t * down - row;
  const double joint = u < 0.025 || v < 0.05 ? 0.72 : 1.0;
  const double tone = 0.9 + 0.14 * painter.spot(static_cast<int>(std::floor(along)) % across, row);
  return scaled(Color{0.56F, 0.50F, 0.41F}, joint * tone * streaks(painter, s, t) * (0.92 + 0.1 * painter.fine(s, t)));
}

Color cast(const Painter& painter, double s, double t) {
  return scaled(Color{0.44F, 0.43F, 0.41F}, streaks(painter, s, 2.0 * t) * (0.9 + 0.14 * painter.fine(s, t)));
}

void add_facades(WorldBuilder& builder, const Painter& painter, Painter& paint, CitySurfaces& made) {
  constexpr Color kCream{0.62F, 0.59F, 0.53F}, kDark{0.06F, 0.065F, 0.07F}, kLintel{0.5F, 0.46F, 0.39F};
  // Adds a wall with and without windows, once per tint.
  const auto add = [&](std::vector<Facade>& into, const std::string& name, double bay_m, double floor_m, const auto& wall,
                       const auto& with_windows, const std::vector<Color>& tints) {
    const std::uint16_t plain = builder.texture(
        name + " wall", 256, 256, [&](float s, float t) { return wall(static_cast<double>(s), static_cast<double>(t)); });
    const auto full = bays(bay_m, floor_m, 4, with_windows);
    const std::uint16_t windows = builder.texture(
        name + " windows", 512, 512, [&](float s, float t) { return full(static_cast<double>(s), static_cast<double>(t)); });
    for (const Color& tint : tints) {
      const std::string number = " " + std::to_string(into.size() + 1);
      const auto kind = static_cast<std::uint16_t>(Kind::building);
      Facade facade{0, 0, bay_m, floor_m, 4};
      facade.windows = builder.material({name + " facade" + number, tint, kind, windows});
      facade.plain = builder.material({name + " wall" + number, tint, kind, plain});
      into.push_back(facade);
    }
  };

  const auto brick_wall = [&](double s, double t) { return bricks(painter, s, t, 40, 128); };
  const auto brick = [&, brick_wall](const Spot& at) {
    const double x = at.x - 0.8, y = at.y - 0.95;
    if (within(x, 0.0, 1.2) && within(y, 0.0, 1.75)) return window(painter, x, y, 1.2, 1.75, 1, 2, kCream, at.which);
    if (within(x, -0.12, 1.32) && within(y, -0.16, 0.0)) return scaled(kLintel, y > -0.03 ? 1.1 : 0.9);  // sill
    if (within(x, -0.1, 1.3) && within(y, 1.75, 2.02)) return scaled(kLintel, 0.95 + 0.1 * painter.fine(at.s, at.t));
    const double below = within(x, -0.1, 1.3) && within(y, -0.7, -0.16) ? 0.86 : 1.0;  // stains below the sill
    return scaled(brick_wall(at.s, at.t), below);
  };
  add(made.brick, "brick", 2.8, 3.3, brick_wall, brick,
      {{1.0F, 1.0F, 1.0F}, {0.78F, 0.74F, 0.78F}, {1.0F, 1.0F, 0.86F}, {0.62F, 0.62F, 0.66F}});

  const auto plaster_wall = [&](double s, double t) { return plastered(painter, s, t); };
  const auto plaster = [&, plaster_wall](const Spot& at) {
    const double x = at.x - 0.95, y = at.y - 0.8;
    if (within(x, 0.0, 1.1) && within(y, 0.0, 1.85)) return window(painter, x, y, 1.1, 1.85, 2, 3, kCream, at.which + 20);
    if (within(x, -0.16, 1.26) && within(y, -0.14, 2.02)) return Color{0.8F, 0.78F, 0.74F};  // surround
    const bool has_shutters = painter.spot(at.which, 9) < 0.55;
    const double shutter = x < 0.0 ? -0.16 - x : x - 1.26;
    if (has_shutters && within(shutter, 0.0, 0.5) && within(y, -0.02, 1.88)) {
      const double slat = within(y, 0.08, 1.76) && within(shutter, 0.06, 0.44) ? 0.7 + 0.3 * wave(14.0 * y) : 1.0;
      return scaled(Color{0.13F, 0.2F, 0.17F}, slat);
    }
    return plaster_wall(at.s, at.t);
  };
  add(made.plaster, "plaster", 3.0, 3.2, plaster_wall, plaster,
      {{0.98F, 0.93F, 0.8F},
       {0.93F, 0.72F, 0.44F},
       {0.86F, 0.56F, 0.44F},
       {0.7F, 0.82F, 0.8F},
       {0.95F, 0.95F, 0.95F},
       {0.8F, 0.8F, 0.62F}});

  const auto stone_wall = [&](double s, double t) { return ashlar(painter, s, t, 12, 24); };
  const auto stone = [&, stone_wall](const Spot& at) {
    const double x = at.x - 0.55, y = at.y - 0.75;
    if (within(x, 0.0, 1.9) && within(y, 0.0, 2.1)) return window(painter, x, y, 1.9, 2.1, 3, 2, kDark, at.which + 40);
    if (within(x, 0.0, 1.9)) {  // a spandrel
      const double relief = within(y + 0.75, 0.1, 0.62) && within(x, 0.15, 1.75) ? 0.55 + 0.35 * wave(2.0 * x) : 0.8;
      return scaled(Color{0.3F, 0.26F, 0.21F}, relief);
    }
    return stone_wall(at.s, at.t);
  };
  add(made.stone, "stone", 3.0, 3.5, stone_wall, stone, {{1.0F, 1.0F, 1.0F}, {0.86F, 0.83F, 0.82F}, {1.0F, 0.93F, 0.82F}});

  const auto metal_wall = [&](double s, double t) {
    const double joint = wave(8.0 * s) > 0.97 || wave(8.0 * t) > 0.97 ? 0.6 : 1.0;
    return scaled(Color{0.33F, 0.35F, 0.37F}, joint * (0.95 + 0.08 * painter.coarse(s, t)));
  };
  const auto curtain = [&](const Spot& at) {
    const double half = at.x < 1.5 ? at.x : at.x - 1.5;
    const int which = 2 * at.which + (at.x < 1.5 ? 0 : 1);
    if (half < 0.045 || half > 1.455 || at.y < 0.05 || at.y > 3.55) return Color{0.26F, 0.28F, 0.3F};
    if (at.y < 0.85) return mixed(Color{0.05F, 0.09F, 0.12F}, Color{0.09F, 0.14F, 0.19F}, at.y);  // in front of the slab
    if (at.y < 0.9) return Color{0.2F, 0.22F, 0.24F};
    const double u = half / 1.5, v = (at.y - 0.9) / 2.65;
    const double tilt = painter.spot(which, 5);  // panes are slightly tilted, so each reflects a different part of the sky
    const double cloud = painter.coarse(0.5 * at.s + 0.2 * tilt, 0.4 * at.t + 0.15 * tilt);
    Color glass = mixed(Color{0.07F, 0.13F, 0.2F}, Color{0.30F, 0.42F, 0.54F},
                        std::clamp(0.2 + 0.35 * v + 1.6 * (cloud - 0.45) + 0.25 * (tilt - 0.5), 0.0, 1.0));
    if (painter.spot(which, 6) < 0.09) glass = mixed(glass, Color{0.6F, 0.42F, 0.2F}, 0.35 + 0.4 * (1.0 - u));
    if (painter.spot(which, 7) < 0.22 && v > 0.35 + 0.6 * painter.spot(which, 8)) {
      glass = mixed(glass, Color{0.42F, 0.44F, 0.45F}, 0.55);
    }
    return glass;
  };
  add(made.glass, "glass", 3.0, 3.6, metal_wall, curtain, {{0.9F, 1.0F, 1.0F}, {0.72F, 0.9F, 0.84F}, {0.82F, 0.84F, 0.95F}});

  const auto concrete_wall = [&](double s, double t) {
    const double joint = wave(4.0 * s) > 0.985 || wave(4.0 * t) > 0.985 ? 0.7 : 1.0;
    return scaled(cast(painter, s, t), joint);
  };
  const auto concrete = [&](const Spot& at) {
    const double y = at.y - 1.0;
    if (within(y, 0.0, 1.5)) return window(painter, at.x, y, 3.3, 1.5, 3, 1, kDark, at.which + 60);
    if (within(y, -0.1, 0.0)) return Color{0.3F, 0.29F, 0.28F};
    return cast(painter, at.s, at.t);
  };
  add(made.concrete, "concrete", 3.2, 3.1, concrete_wall, concrete,
      {{1.0F, 1.0F, 1.0F}, {1.0F, 0.92F, 0.82F}, {0.85F, 0.9F, 0.95F}});

  // Shops: a sign above a door or a display window.
  constexpr std::array<Color, 4> kSigns{
      {{0.30F, 0.04F, 0.035F}, {0.03F, 0.11F, 0.075F}, {0.035F, 0.06F, 0.17F}, {0.10F, 0.085F, 0.075F}}};
  const auto shop = [&](const Spot& at) {
    const int which = at.which;
    const double x = at.x, y = at.y;
    const Color wood = scaled(kSigns[static_cast<std::size_t>(which)], 0.75);
    if (y > 4.0) return Color{0.4F, 0.38F, 0.35F};
    if (x < 0.24 || x > 3.76) return scaled(Color{0.42F, 0.39F, 0.35F}, 0.92 + 0.12 * painter.fine(at.s, at.t));  // pier
    if (y > 3.15) {  // the sign with pretend lettering
      const double from = 0.9, pitch = 0.24;
      const auto letter = static_cast<int>(std::floor((x - from) / pitch));
      const double u = (x - from) / pitch - letter, v = (y - 3.38) / 0.38;
      const auto bit = static_cast<int>(std::floor(3.0 * u)) + 3 * static_cast<int>(std::floor(4.0 * v));
      const bool is_letter = letter >= 0 && letter < 9 && painter.spot(letter + 11 * which, 30) > 0.12;
      if (is_letter && within(v, 0.0, 1.0) && u < 0.78 && painter.spot(bit + 16 * letter, 31 + which) > 0.36) {
        return Color{0.72F, 0.66F, 0.5F};
      }
      return y > 3.9 || y < 3.22 ? scaled(kSigns[static_cast<std::size_t>(which)], 1.4) : kSigns[static_cast<std::size_t>(which)];
    }
    if (y < 0.45) return scaled(wood, wave(2.0 * x) > 0.93 ? 0.6 : 1.0);
    const bool is_door = within(x, 1.45, 2.55) && which % 2 == 0;
    if (x < 0.32 || x > 3.68 || y > 3.07 || (which % 2 == 0 && (within(x, 1.38, 1.46) || within(x, 2.54, 2.62)))) return wood;
    if (is_door && (x < 1.55 || x > 2.45 || within(y, 2.28, 2.4))) return wood;
    if (which % 2 == 1 && within(x, 1.96, 2.04)) return wood;
    // Lit shelves behind the glass.
    const auto shelf = static_cast<int>(std::floor(2.2 * y)), place = static_cast<int>(std::floor(5.0 * x));
    const double filled = painter.spot(place + 20 * which, shelf + 50);
    const double rest = 2.2 * y - shelf;
    Color inside = mixed(Color{0.30F, 0.20F, 0.10F}, Color{0.08F, 0.06F, 0.045F}, std::clamp(0.5 * y - 0.1, 0.0, 1.0));
    if (y > 2.6) inside = Color{0.7F, 0.55F, 0.32F};
    if (!is_door && y < 2.3 && rest < 0.25 + 0.6 * filled && filled > 0.25) {
      const double hue = painter.spot(place + 7, shelf + 3 * which);
      inside = mixed(Color{0.36F, 0.11F, 0.05F}, Color{0.06F, 0.17F, 0.2F}, hue);
    }
    const double sky = std::clamp(1.1 * painter.coarse(at.s, 0.5 * at.t) - 0.46 + 0.05 * (x + y), 0.0, 0.28);
    return mixed(inside, Color{0.16F, 0.23F, 0.32F}, sky);
  };
  made.shops = {0, 0, 4.0, 4.2, 1};
  made.shops.windows = paint.textured("shop facade", Kind::building, 512, 256, bays(4.0, 4.2, 1, shop));

  // Ground floor of flats and offices: rusticated stone and tall windows.
  const auto hall = [&](const Spot& at) {
    const double x = at.x - 0.9, y = at.y - 0.9;
    if (within(x, 0.0, 1.4) && within(y, 0.0, 2.3)) return window(painter, x, y, 1.4, 2.3, 2, 3, kDark, at.which + 80);
    if (within(x, -0.14, 1.54) && within(y, -0.14, 2.5)) return Color{0.5F, 0.46F, 0.4F};
    return scaled(ashlar(painter, at.s, at.t, 16, 8), at.y < 0.6 ? 0.6 : 0.85);
  };
  made.hall = {0, 0, 3.2, 4.2, 1};
  made.hall.windows = paint.textured("hall facade", Kind::building, 512, 256, bays(3.2, 4.2, 1, hall));
  made.shops.plain = made.hall.plain = made.stone[1].plain;
}

void add_ground(const Painter& painter, Painter& paint, CitySurfaces& made) {
  const auto tar = [&](double s, double t) {
    const double patch = painter.coarse(s, t) > 0.62 ? 0.86 : 1.0;
    const double crack = std::abs(painter.coarse(s, t, 2.0) - 0.5) < 0.008 ? 0.72 : 1.0;
    const double grit = 0.78 + 0.44 * painter.fine(s, t, 3.0);
    return scaled(Color{0.105F, 0.103F, 0.10F}, patch * crack * grit * (0.85 + 0.3 * painter.coarse(s, t)));
  };
  const auto painted = [&](double s, double t, const Color& under, const Color& color) {
    return mixed(under, color, std::clamp(1.5 - painter.coarse(s, t, 3.0) - 0.35 * painter.fine(s, t, 2.0), 0.15, 0.92));
  };
  constexpr Color kLine{0.62F, 0.62F, 0.60F}, kYellow{0.62F, 0.42F, 0.07F};
  // x: m from the left kerb across the 10 m roadway; y: m along the road. The texture covers 10 m of road.
  made.lanes = paint.textured("road with lanes", Kind::road, 512, 512, [&](double s, double t) {
    const double x = 10.0 * s, y = 10.0 * t;
    const double wheel = std::min({std::abs(x - 2.9), std::abs(x - 4.3), std::abs(x - 5.7), std::abs(x - 7.1)});
    Color color = scaled(tar(s, t), 1.0 - 0.14 * std::clamp(1.0 - 2.5 * wheel, 0.0, 1.0));
    if (x < 0.35 || x > 9.65) color = scaled(color, 0.75);  // the gutter
    const double dx = x - 3.6, dy = y - 6.2, far = dx * dx + dy * dy;
    if (far < 0.1)
      color = far > 0.075 ? Color{0.03F, 0.03F, 0.03F} : scaled(Color{0.13F, 0.12F, 0.11F}, 0.6 + 0.4 * wave(5.0 * x));
    if (std::abs(x - 5.0) < 0.07 && y - 5.0 * std::floor(y / 5.0) < 3.0) return painted(s, t, color, kYellow);
    const bool is_bay = std::min(x, 10.0 - x) < 2.1 && std::abs(y - 5.0 * std::floor(y / 5.0) - 2.5) < 0.05;
    if (std::abs(x - 2.1) < 0.05 || std::abs(x - 7.9) < 0.05 || is_bay) return painted(s, t, color, kLine);
    return color;
  });
  // The texture covers 5 m of road: a stop line, then the crossing.
  made.zebra = paint.textured("road with crossing", Kind::road, 512, 256, [&](double s, double t) {
    const double x = 10.0 * s, y = 5.0 * t;
    const Color color = tar(s, 0.5 * t);
    if (within(y, 0.3, 0.7) && within(x, 5.1, 9.7)) return painted(s, t, color, kLine);
    if (within(y, 1.3, 4.3) && within(x, 0.5, 9.5) && x - std::floor(x) < 0.52) return painted(s, t, color, kLine);
    return color;
  });
  made.asphalt = paint.textured("road", Kind::road, 256, 256, tar);
  made.pavement = paint.textured("pavement", Kind::pavement, 256, 256, [&](double s, double t) {
    const auto row = static_cast<int>(std::floor(5.0 * t));
    const double along = 5.0 * s + 0.5 * (row % 2), u = along - std::floor(along), v = 5.0 * t - row;
    const double joint = std::min({u, 1.0 - u, v, 1.0 - v}) < 0.025 ? 0.6 : 1.0;
    const double tone = 0.86 + 0.2 * painter.spot(static_cast<int>(std::floor(along)) % 5, row + 40);
    return scaled(Color{0.31F, 0.295F, 0.275F}, joint * tone * (0.86 + 0.16 * painter.fine(s, t) + 0.14 * painter.coarse(s, t)));
  });
  made.kerb = paint.textured("kerb", Kind::pavement, 64, 64, [&](double s, double t) {
    return scaled(Color{0.40F, 0.385F, 0.365F}, (s < 0.04 ? 0.6 : 1.0) * (0.8 + 0.3 * painter.fine(s, t)));
  });
  made.grass = paint.textured("grass", Kind::grass, 256, 256, [&](double s, double t) {
    const Color blades = mixed(Color{0.045F, 0.10F, 0.02F}, Color{0.15F, 0.235F, 0.055F}, painter.fine(s, t, 2.0));
    return scaled(blades, 0.7 + 0.7 * painter.coarse(s, t));
  });
  made.gravel = paint.textured("path", Kind::pavement, 128, 128, [&](double s, double t) {
    return scaled(Color{0.42F, 0.355F, 0.27F}, 0.72 + 0.35 * painter.fine(s, t) + 0.15 * painter.coarse(s, t));
  });
  made.water = paint.plain("water", Kind::water, {0.07F, 0.16F, 0.19F});
}

void add_the_rest(WorldBuilder& builder, const Painter& painter, Painter& paint, CitySurfaces& made) {
  made.trim = paint.textured("trim", Kind::building, 64, 64, [&](double s, double t) {
    return scaled(Color{0.52F, 0.48F, 0.42F}, 0.85 + 0.2 * painter.fine(s, t) + 0.1 * (painter.coarse(s, t) - 0.5));
  });
  const std::uint16_t felt = builder.texture("roof", 256, 256, [&](float across, float down) {
    const auto s = static_cast<double>(across), t = static_cast<double>(down);
    const double seam = wave(4.0 * s) > 0.98 ? 0.8 : 1.0;
    const double pool = std::clamp(3.0 * (painter.coarse(s, t) - 0.35), 0.0, 1.0);
    return scaled(mixed(Color{0.40F, 0.39F, 0.38F}, Color{0.62F, 0.60F, 0.575F}, pool), seam * (0.85 + 0.3 * painter.fine(s, t)));
  });
  constexpr std::array<Color, 5> kRoofs{
      {{0.45F, 0.45F, 0.45F}, {0.75F, 0.71F, 0.64F}, {0.26F, 0.26F, 0.28F}, {0.58F, 0.43F, 0.36F}, {0.95F, 0.95F, 0.92F}}};
  for (const Color& tint : kRoofs) {
    const std::string name = "roof " + std::to_string(made.roofs.size() + 1);
    made.roofs.push_back(builder.material({name, tint, static_cast<std::uint16_t>(Kind::roof), felt}));
  }
  made.tiles = paint.textured("roof tiles", Kind::roof, 256, 256, [&](double s, double t) {
    const double rows = 10.0 * t, v = rows - std::floor(rows);
    const auto row = static_cast<int>(std::floor(rows));
    const double columns = 12.0 * s + 0.5 * (row % 2);
    const double round = 0.75 + 0.35 * (1.0 - wave(columns));
    const double tone = painter.spot(static_cast<int>(std::floor(columns)) % 12, row + 20);
    return scaled(mixed(Color{0.24F, 0.085F, 0.05F}, Color{0.38F, 0.16F, 0.09F}, tone),
                  round * (v < 0.18 ? 0.5 : 0.85 + 0.2 * v) * (0.85 + 0.3 * painter.coarse(s, t)));
  });
  made.iron = paint.plain("iron", Kind::building, {0.045F, 0.045F, 0.05F});
  made.tank = paint.textured("water tank", Kind::roof, 128, 64, [&](double s, double t) {
    const double stave = wave(16.0 * s) > 0.9 ? 0.55 : 0.8 + 0.3 * painter.spot(static_cast<int>(16.0 * s), 3);
    const double hoop = wave(4.0 * t) > 0.93 ? 0.35 : 1.0;
    return scaled(Color{0.27F, 0.175F, 0.105F}, stave * hoop * (0.85 + 0.25 * painter.fine(s, t)));
  });
  made.machine = paint.textured("air conditioner", Kind::roof, 64, 64, [&](double s, double t) {
    const bool is_edge = std::min({s, 1.0 - s, t, 1.0 - t}) < 0.08;
    return scaled(Color{0.46F, 0.47F, 0.46F}, is_edge ? 1.0 : 0.45 + 0.4 * wave(8.0 * t));
  });
  made.panes = paint.textured("glass panes", Kind::glass, 128, 128, [&](double s, double t) {
    if (wave(s + 0.5) < 0.06 || wave(t + 0.5) < 0.05) return Color{0.2F, 0.21F, 0.22F};
    return mixed(Color{0.09F, 0.14F, 0.19F}, Color{0.26F, 0.36F, 0.46F},
                 std::clamp(1.1 - t + 0.6 * painter.coarse(s, t) - 0.3, 0.0, 1.0));
  });
  made.door = paint.textured("door", Kind::building, 64, 128, [&](double s, double t) {
    if (s < 0.07 || s > 0.93 || t < 0.04) return Color{0.5F, 0.46F, 0.4F};
    if (within(t, 0.07, 0.24)) return pane(painter, s, 0.8, 5);
    const double half = std::abs(s - 0.5);
    const bool is_panel = within(half, 0.08, 0.34) && (within(t, 0.32, 0.58) || within(t, 0.65, 0.93));
    const Color wood = half < 0.015 ? Color{0.02F, 0.015F, 0.01F} : Color{0.12F, 0.05F, 0.03F};
    return scaled(wood, (is_panel ? 0.7 : 1.0) * (0.8 + 0.3 * painter.fine(0.3 * s, t)));
  });
  made.bark = paint.textured("trunk", Kind::trunk, 64, 64, [&](double s, double t) {
    return mixed(Color{0.10F, 0.075F, 0.05F}, Color{0.25F, 0.19F, 0.13F}, painter.fine(s, 0.25 * t));
  });
  const auto crown = [&](const std::string& name, const Color& dark, const Color& bright) {
    made.leaves.push_back(paint.textured(name, Kind::tree, 128, 128, [&](double s, double t) {
      const double value = 0.65 * painter.fine(s, t) + 0.35 * painter.coarse(s, t, 2.0);
      return mixed(dark, bright, std::clamp(2.2 * value - 0.6, 0.0, 1.0));
    }));
  };
  crown("plane tree", {0.02F, 0.06F, 0.012F}, {0.16F, 0.27F, 0.06F});
  crown("linden", {0.035F, 0.07F, 0.012F}, {0.26F, 0.31F, 0.07F});
  crown("maple", {0.10F, 0.05F, 0.012F}, {0.44F, 0.23F, 0.05F});
  const auto striped = [&](const std::string& name, const Color& color) {
    made.awnings.push_back(paint.textured(
        name, Kind::awning, 64, 16, [&](double s, double) { return wave(2.0 * s) < 0.5 ? color : Color{0.62F, 0.6F, 0.55F}; }));
  };
  striped("red awning", {0.42F, 0.05F, 0.04F});
  striped("green awning", {0.04F, 0.2F, 0.11F});
  striped("blue awning", {0.05F, 0.12F, 0.32F});
  made.poster = paint.textured("poster", Kind::sign, 64, 128, [&](double s, double t) {
    if (std::min({s, 1.0 - s}) < 0.06 || std::min(t, 1.0 - t) < 0.03) return Color{0.08F, 0.08F, 0.09F};
    const double dx = s - 0.5, dy = 2.0 * (t - 0.36);
    if (dx * dx + dy * dy < 0.08) return Color{0.75F, 0.55F, 0.1F};
    if (within(t, 0.7, 0.9) && wave(10.0 * t) < 0.5 && within(s, 0.16, 0.5 + 0.4 * painter.spot(static_cast<int>(20.0 * t), 4))) {
      return Color{0.7F, 0.7F, 0.68F};
    }
    return mixed(Color{0.03F, 0.22F, 0.3F}, Color{0.3F, 0.08F, 0.2F}, t);
  });
  made.wood = paint.plain("bench", Kind::furniture, {0.28F, 0.155F, 0.075F});
  made.bin = paint.plain("bin", Kind::furniture, {0.05F, 0.085F, 0.065F});
  made.hydrant = paint.plain("hydrant", Kind::furniture, {0.5F, 0.045F, 0.03F});
  made.pole = paint.plain("pole", Kind::pole, {0.075F, 0.085F, 0.085F});
  made.lamp = paint.plain("lamp", Kind::pole, {0.75F, 0.7F, 0.55F});
  made.red = paint.plain("red light", Kind::pole, {0.75F, 0.04F, 0.03F});
  made.amber = paint.plain("amber light", Kind::pole, {0.35F, 0.2F, 0.02F});
  made.green = paint.plain("green light", Kind::pole, {0.03F, 0.2F, 0.09F});
  made.cable = paint.plain("cable", Kind::cable, {0.025F, 0.025F, 0.028F});
  made.sign = paint.plain("sign", Kind::sign, {0.04F, 0.12F, 0.36F});
  constexpr std::array<Color, kCarColors> kColors{{{0.018F, 0.018F, 0.018F},
                                                   {0.34F, 0.35F, 0.36F},
                                                   {0.035F, 0.035F, 0.037F},
                                                   {0.02F, 0.025F, 0.03F},
                                                   {0.15F, 0.21F, 0.28F},
                                                   {0.8F, 0.8F, 0.75F},
                                                   {0.42F, 0.02F, 0.02F},
                                                   {0.56F, 0.57F, 0.57F},
                                                   {0.22F, 0.23F, 0.245F},
                                                   {0.035F, 0.037F, 0.042F},
                                                   {0.36F, 0.03F, 0.028F},
                                                   {0.05F, 0.11F, 0.26F},
                                                   {0.62F, 0.38F, 0.03F},
                                                   {0.07F, 0.14F, 0.09F},
                                                   {0.36F, 0.31F, 0.22F},
                                                   {0.12F, 0.24F, 0.33F}}};
  made.car = paint.textured("car", Kind::car, kCarColors, 1,
                            [&](double s, double) { return kColors[static_cast<std::size_t>(s * kCarColors)]; });
}

}  // namespace

CitySurfaces add_city_surfaces(WorldBuilder& builder, std::uint64_t seed) {
  Painter painter(builder, seed);
  CitySurfaces made;
  add_ground(painter, painter, made);
  add_facades(builder, painter, painter, made);
  add_the_rest(builder, painter, painter, made);
  return made;
}

}  // namespace flockstep::streets
