#include "generators/furniture.hpp"

#include <algorithm>
#include <cmath>

#include "generators/parts.hpp"

namespace flockstep::indoors {
namespace {

// Returns the spot at (x, y) in the frame of another spot. `facing` is also given in that frame.
Spot within(const Spot& spot, double x, double y, const Vec2d& facing = Vec2d::UnitY()) {
  const Vec2d ahead = spot.facing, right(ahead.y(), -ahead.x());
  return {spot.at + x * right + y * ahead, facing.x() * right + facing.y() * ahead, spot.floor};
}

}  // namespace

MeshPart shade(const Rect& rect, double out, double repeat_m) {
  constexpr double kAbove = 0.003;              // m, above the floor
  constexpr double kWithin = 0.02, kAt = 0.98;  // t at the texture's ends, inset so that it does not wrap
  const Rect outer = rect.grown(out);
  const auto corners = [](const Rect& r) {
    return std::array<Vec2d, 4>{r.low, Vec2d(r.high.x(), r.low.y()), r.high, Vec2d(r.low.x(), r.high.y())};
  };
  const std::array<Vec2d, 4> a = corners(outer), b = corners(rect);
  MeshPart part;
  const auto at = [&](const Vec2d& corner, int axis, double t) {
    return add_vertex(part, {corner.x(), corner.y(), kAbove}, corner[axis] / repeat_m, t);
  };
  const auto quad = [&](std::int32_t p, std::int32_t q, std::int32_t r, std::int32_t s) {
    add_triangle(part, p, q, r);
    add_triangle(part, p, r, s);
  };
  for (std::size_t i = 0; i < 4; ++i) {
    const std::size_t next = (i + 1) % 4;
    const int axis = i % 2 == 0 ? 0 : 1;
    const std::int32_t p = at(a[i], axis, kAt), q = at(a[next], axis, kAt), r = at(b[next], axis, kWithin);
    quad(p, q, r, at(b[i], axis, kWithin));
  }
  const std::int32_t p = at(b[0], 0, kWithin), q = at(b[1], 0, kWithin), r = at(b[2], 0, kWithin);
  quad(p, q, r, at(b[3], 0, kWithin));
  return part;
}

const char* name(Kind kind) {
  constexpr std::array<const char*, static_cast<std::size_t>(Kind::count)> kNames{
      "floor", "wall",  "ceiling", "door",   "window",  "lamp",     "column",     "desk",    "chair",
      "table", "shelf", "sofa",    "plant",  "monitor", "picture",  "whiteboard", "kitchen", "appliance",
      "rug",   "rack",  "pallet",  "carton", "barrel",  "forklift", "conveyor",   "beam"};
  return kNames[static_cast<std::size_t>(kind)];
}

std::uint16_t Furniture::material(Kind kind) {
  std::optional<std::uint16_t>& made = materials_[static_cast<std::size_t>(kind)];
  if (!made) made = builder_.material({name(kind), {1.0F, 1.0F, 1.0F}, semantic(kind), texture_});
  return *made;
}

Swatch Furniture::any_color() {
  constexpr std::array<Swatch, 12> kBooks{Swatch::white, Swatch::cream, Swatch::dark_grey, Swatch::navy,
                                          Swatch::blue,  Swatch::teal,  Swatch::moss,      Swatch::red,
                                          Swatch::rust,  Swatch::brown, Swatch::plum,      Swatch::sand};
  return kBooks[static_cast<std::size_t>(draws_.below(static_cast<int>(kBooks.size())))];
}

void Furniture::desk(const Spot& spot) {
  Shape shape(spot);
  shape.block({0, 0, 0.725}, {1.6, 0.8, 0.03}, Swatch::oak);
  for (const double x : {-0.72, 0.72}) {
    shape.block({x, -0.3, 0.355}, {0.05, 0.05, 0.71}, Swatch::grey);
    shape.block({x, 0.3, 0.355}, {0.05, 0.05, 0.71}, Swatch::grey);
    shape.block({x, 0, 0.69}, {0.05, 0.6, 0.04}, Swatch::grey);
  }
  shape.block({0, -0.34, 0.5}, {1.4, 0.02, 0.36}, Swatch::light_grey);
  const double side = draws_.below(2) == 0 ? 0.47 : -0.47;
  shape.block({side, 0.05, 0.31}, {0.4, 0.55, 0.54}, Swatch::white);
  for (const double z : {0.13, 0.31, 0.49}) shape.block({side, 0.33, z}, {0.36, 0.015, 0.15}, Swatch::light_grey);
  const double paper = draws_.uniform(-0.6, -0.35) * side / 0.47;
  shape.block({paper, 0.1, 0.745}, {0.21, 0.3, draws_.uniform(0.004, 0.03)}, Swatch::white);
  if (draws_.below(2) == 0) {
    const std::array<Vec2d, 3> mug{Vec2d(0.035, 0.74), Vec2d(0.042, 0.83), Vec2d(0.034, 0.832)};
    shape.turned({0.45, 0.12}, mug, any_color());
  }
  if (draws_.below(2) == 0) {
    for (int i = 0; i < 3; ++i) shape.block({side, -0.22, 0.757 + 0.03 * i}, {0.24, 0.17, 0.028}, any_color());
  }
  add(shape, Kind::desk);

  Shape monitor(spot);
  const bool are_two = draws_.below(3) == 0;
  for (const double x : are_two ? std::array<double, 2>{-0.29, 0.29} : std::array<double, 2>{0.0, 0.0}) {
    const Swatch shown = draws_.below(3) == 0 ? Swatch::desktop : draws_.below(2) == 0 ? Swatch::code : Swatch::slides;
    monitor.block({x, -0.2, 0.747}, {0.24, 0.18, 0.012}, Swatch::dark_grey);
    monitor.block({x, -0.24, 0.84}, {0.05, 0.03, 0.2}, Swatch::dark_grey);
    monitor.block({x, -0.21, 1.05}, {0.56, 0.03, 0.34}, Swatch::black);
    monitor.sheet({x + 0.27, -0.193, 0.895}, {x - 0.27, -0.193, 0.895}, {x - 0.27, -0.193, 1.207}, {x + 0.27, -0.193, 1.207},
                  shown);
    if (!are_two) break;
  }
  monitor.block({0, 0.14, 0.749}, {0.44, 0.14, 0.016}, Swatch::dark_grey, Swatch::keyboard);
  monitor.block({-0.3, 0.14, 0.75}, {0.06, 0.1, 0.02}, Swatch::dark_grey);
  add(monitor, Kind::monitor);
}

void Furniture::chair(const Spot& spot, Swatch cloth) {
  Shape shape(spot);
  for (const std::size_t i : {0U, 3U, 6U, 10U, 13U}) {
    const Vec2d foot = 0.3 * circle()[i];
    shape.rod({0, 0, 0.1}, {foot.x(), foot.y(), 0.06}, 0.04, Swatch::dark_grey);
    shape.block({foot.x(), foot.y(), 0.03}, {0.05, 0.05, 0.06}, Swatch::black);
  }
  const std::array<Vec2d, 2> lift{Vec2d(0.03, 0.08), Vec2d(0.025, 0.42)};
  shape.turned({0, 0}, lift, Swatch::steel);
  shape.cushion({0, 0.02, 0.46}, {0.5, 0.48, 0.09}, 0.03, cloth);
  shape.rod({0, -0.2, 0.44}, {0, -0.27, 0.66}, 0.05, Swatch::dark_grey);
  shape.cushion({0, -0.27, 0.8}, {0.46, 0.08, 0.52}, 0.03, cloth);
  for (const double x : {-0.28, 0.28}) {
    shape.rod({x, -0.08, 0.46}, {x, -0.08, 0.66}, 0.035, Swatch::dark_grey);
    shape.block({x, 0, 0.675}, {0.05, 0.28, 0.03}, Swatch::black);
  }
  add(shape, Kind::chair);
}

void Furniture::meeting_table(const Spot& spot, double across, double deep) {
  Shape shape(spot);
  shape.block({0, 0, 0.73}, {across, deep, 0.04}, Swatch::walnut);
  for (const double x : {-0.3 * across, 0.3 * across}) {
    shape.block({x, 0, 0.36}, {0.1, 0.5 * deep, 0.7}, Swatch::dark_grey);
    shape.block({x, 0, 0.015}, {0.3, 0.8 * deep, 0.03}, Swatch::dark_grey);
  }
  shape.block({0.1, 0, 0.76}, {0.3, 0.22, 0.02}, Swatch::dark_grey);
  for (int i = 0; i < 3; ++i) {
    const double x = draws_.uniform(-0.4, 0.4) * across;
    shape.block({x, (i % 2 == 0 ? 0.3 : -0.3) * deep, 0.755}, {0.21, 0.28, 0.01}, Swatch::white);
  }
  add(shape, Kind::table);
  const Swatch cloth = draws_.below(2) == 0 ? Swatch::dark_grey : any_color();
  const int count = std::max(1, static_cast<int>((across - 0.2) / 0.8));
  for (int i = 0; i < count; ++i) {
    const double x = across * ((i + 0.5) / count - 0.5);
    for (const double side : {-1.0, 1.0}) {
      const double turn = draws_.uniform(-0.3, 0.3);
      chair(within(spot, x, side * (0.5 * deep + draws_.uniform(0.1, 0.35)), Vec2d(turn, -side).normalized()), cloth);
    }
  }
}

void Furniture::round_table(const Spot& spot, double radius) {
  Shape shape(spot);
  const std::array<Vec2d, 4> foot{Vec2d(0.28, 0.0), Vec2d(0.28, 0.02), Vec2d(0.04, 0.05), Vec2d(0.04, 0.71)};
  shape.turned({0, 0}, foot, Swatch::steel, 16);
  const std::array<Vec2d, 3> top{Vec2d(radius - 0.03, 0.71), Vec2d(radius, 0.73), Vec2d(radius, 0.75)};
  shape.turned({0, 0}, top, Swatch::white, 16);
  add(shape, Kind::table);
}

void Furniture::stool(const Spot& spot) {
  Shape shape(spot);
  for (const std::size_t i : {2U, 6U, 10U, 14U}) {
    const Vec2d way = circle()[i];
    shape.rod({0.2 * way.x(), 0.2 * way.y(), 0.0}, {0.13 * way.x(), 0.13 * way.y(), 0.43}, 0.03, Swatch::oak);
  }
  const std::array<Vec2d, 4> seat{Vec2d(0.17, 0.42), Vec2d(0.2, 0.44), Vec2d(0.2, 0.47), Vec2d(0.17, 0.49)};
  shape.turned({0, 0}, seat, Swatch::orange, 16);
  add(shape, Kind::chair);
}

void Furniture::bookshelf(const Spot& spot, const Vec3d& size) {
  Shape shape(spot);
  const double w = size.x(), d = size.y(), h = size.z();
  shape.block({0, -0.5 * d + 0.01, 0.5 * h}, {w, 0.02, h}, Swatch::oak);
  for (const double x : {-0.5 * w + 0.012, 0.5 * w - 0.012}) shape.block({x, 0, 0.5 * h}, {0.024, d, h}, Swatch::oak);
  const int levels = std::max(1, static_cast<int>(h / 0.37));
  const double pitch = (h - 0.1) / levels;
  for (int level = 0; level <= levels; ++level) {
    const double z = 0.07 + level * pitch;
    shape.block({0, 0.01, z}, {w - 0.05, d - 0.02, 0.024}, Swatch::oak);
    if (level == levels) break;
    double x = -0.5 * w + 0.04;
    while (x < 0.5 * w - 0.14) {
      const int what = draws_.below(9);
      if (what == 0) {  // a gap
        x += draws_.uniform(0.06, 0.2);
      } else if (what == 1) {  // a box file
        shape.block({x + 0.05, 0, z + 0.14}, {0.095, 0.8 * d, 0.25}, any_color());
        x += 0.105;
      } else {  // books
        const Swatch color = any_color();
        const double thick = draws_.uniform(0.035, 0.11), high = draws_.uniform(0.5, 0.82) * pitch;
        shape.block({x + 0.5 * thick, 0, z + 0.012 + 0.5 * high}, {thick - 0.004, draws_.uniform(0.6, 0.8) * d, high}, color);
        x += thick;
      }
    }
  }
  add(shape, Kind::shelf);
}

void Furniture::cabinet(const Spot& spot, const Vec3d& size) {
  Shape shape(spot);
  const double w = size.x(), d = size.y(), h = size.z();
  shape.block({0, 0, 0.04}, {w - 0.04, d - 0.06, 0.08}, Swatch::dark_grey);
  shape.block({0, 0, 0.5 * h + 0.04}, {w, d, h - 0.08}, Swatch::white);
  const int doors = std::max(1, static_cast<int>(w / 0.45));
  for (int i = 0; i < doors; ++i) {
    const double x = w * ((i + 0.5) / doors - 0.5);
    shape.block({x, 0.5 * d + 0.005, 0.5 * h + 0.04}, {w / doors - 0.015, 0.012, h - 0.12}, Swatch::light_grey);
    shape.block({x + (i % 2 == 0 ? 0.3 : -0.3) * w / doors, 0.5 * d + 0.02, 0.6 * h}, {0.02, 0.02, 0.14}, Swatch::steel);
  }
  add(shape, Kind::shelf);
}

void Furniture::sofa(const Spot& spot, double across, Swatch cloth) {
  Shape shape(spot);
  shape.cushion({0, 0, 0.21}, {across, 0.86, 0.26}, 0.04, cloth);
  shape.cushion({0, -0.33, 0.56}, {across, 0.22, 0.5}, 0.06, cloth);
  for (const double side : {-1.0, 1.0}) {
    shape.cushion({side * (0.5 * across - 0.09), 0.02, 0.43}, {0.18, 0.82, 0.3}, 0.05, cloth);
    for (const double y : {-0.35, 0.35})
      shape.block({side * (0.5 * across - 0.1), y, 0.04}, {0.06, 0.06, 0.08}, Swatch::dark_grey);
  }
  const int seats = std::max(1, static_cast<int>((across - 0.3) / 0.65));
  const double wide = (across - 0.38) / seats;
  for (int i = 0; i < seats; ++i) {
    const double x = (i + 0.5 - 0.5 * seats) * wide;
    shape.cushion({x, 0.08, 0.41}, {wide - 0.02, 0.68, 0.17}, 0.05, cloth);
    shape.cushion({x, -0.17, 0.63}, {wide - 0.03, 0.16, 0.4}, 0.06, cloth);
  }
  shape.cushion({0.32 * across, -0.05, 0.6}, {0.4, 0.14, 0.36}, 0.06, any_color());
  add(shape, Kind::sofa);
}

void Furniture::coffee_table(const Spot& spot) {
  Shape shape(spot);
  shape.block({0, 0, 0.38}, {1.1, 0.6, 0.035}, Swatch::walnut);
  shape.block({0, 0, 0.14}, {1.0, 0.5, 0.02}, Swatch::walnut);
  for (const double x : {-0.5, 0.5}) {
    for (const double y : {-0.25, 0.25}) shape.block({x, y, 0.19}, {0.04, 0.04, 0.38}, Swatch::dark_grey);
  }
  shape.block({0.2, 0.05, 0.41}, {0.3, 0.21, 0.02}, any_color());
  shape.block({0.22, 0.06, 0.43}, {0.28, 0.2, 0.02}, any_color());
  const std::array<Vec2d, 3> bowl{Vec2d(0.06, 0.4), Vec2d(0.14, 0.47), Vec2d(0.13, 0.472)};
  shape.turned({-0.28, 0}, bowl, Swatch::teal, 16);
  add(shape, Kind::table);
}

void Furniture::rug(const Spot& spot, double across, double deep) {
  Shape shape(spot);
  const double x = 0.5 * across, y = 0.5 * deep, z = 0.006;
  shape.sheet({-x, -y, z}, {x, -y, z}, {x, y, z}, {-x, y, z}, Swatch::rug);
  add(shape, Kind::rug);
}

void Furniture::plant(const Spot& spot, double high) {
  Shape shape(spot);
  const double pot = 0.28 * std::min(1.0, high);
  const std::array<Vec2d, 4> clay{Vec2d(0.6 * pot, 0.0), Vec2d(0.85 * pot, 1.5 * pot), Vec2d(0.95 * pot, 1.5 * pot),
                                  Vec2d(0.9 * pot, 1.45 * pot)};
  shape.turned({0, 0}, clay, draws_.below(2) == 0 ? Swatch::white : Swatch::rust, 16);
  const double from = 1.45 * pot;
  const Swatch green = draws_.below(2) == 0 ? Swatch::leaf : Swatch::moss;
  const int leaves = 26;
  for (int i = 0; i < leaves; ++i) {
    const Vec2d way = circle()[static_cast<std::size_t>(draws_.below(16))];
    const Vec2d bent = Vec2d(way + draws_.point({-0.2, -0.2}, {0.2, 0.2})).normalized();
    const double steep = draws_.uniform(0.25, 1.0);
    shape.blade({0.05 * way.x(), 0.05 * way.y(), from}, bent, (0.42 - 0.2 * steep) * high, steep * (high - from),
                draws_.uniform(0.08, 0.14), green);
  }
  add(shape, Kind::plant);
}

void Furniture::kitchen(const Spot& spot, double across) {
  Shape shape(spot);
  shape.block({0, -0.02, 0.05}, {across - 0.02, 0.5, 0.1}, Swatch::dark_grey);
  shape.block({0, 0, 0.48}, {across, 0.58, 0.76}, Swatch::white);
  shape.block({0, 0.01, 0.885}, {across + 0.02, 0.62, 0.05}, Swatch::walnut);
  shape.block({0, -0.28, 1.16}, {across, 0.02, 0.5}, Swatch::teal);
  shape.block({0, -0.12, 1.76}, {across, 0.34, 0.7}, Swatch::white);
  const int doors = std::max(2, static_cast<int>(across / 0.6));
  for (int i = 0; i < doors; ++i) {
    const double x = across * ((i + 0.5) / doors - 0.5), wide = across / doors - 0.015;
    shape.block({x, 0.295, 0.48}, {wide, 0.012, 0.72}, i % 2 == 0 ? Swatch::cream : Swatch::light_grey);
    shape.block({x, 0.31, 0.8}, {0.5 * wide, 0.02, 0.02}, Swatch::steel);
    shape.block({x, 0.055, 1.76}, {wide, 0.012, 0.66}, Swatch::cream);
    shape.block({x, 0.07, 1.47}, {0.5 * wide, 0.02, 0.02}, Swatch::steel);
  }
  add(shape, Kind::kitchen);
  Shape machines(spot);
  machines.block({-0.3 * across, 0, 0.915}, {0.55, 0.42, 0.012}, Swatch::steel);
  machines.rod({-0.3 * across, -0.2, 0.92}, {-0.3 * across, -0.2, 1.2}, 0.03, Swatch::steel);
  machines.rod({-0.3 * across, -0.2, 1.19}, {-0.3 * across, 0.0, 1.17}, 0.03, Swatch::steel);
  machines.block({0.1 * across, -0.02, 1.08}, {0.28, 0.34, 0.34}, Swatch::black);
  machines.block({0.1 * across, 0.16, 1.19}, {0.2, 0.03, 0.08}, Swatch::steel);
  machines.block({0.35 * across, -0.02, 1.05}, {0.48, 0.36, 0.28}, Swatch::steel);
  machines.block({0.35 * across - 0.06, 0.165, 1.05}, {0.3, 0.012, 0.22}, Swatch::black);
  add(machines, Kind::appliance);
}

void Furniture::fridge(const Spot& spot) {
  Shape shape(spot);
  shape.block({0, 0, 0.95}, {0.64, 0.62, 1.88}, Swatch::light_grey);
  shape.block({0, 0.315, 0.4}, {0.62, 0.02, 0.7}, Swatch::steel);
  shape.block({0, 0.315, 1.33}, {0.62, 0.02, 1.1}, Swatch::steel);
  shape.block({0.25, 0.345, 0.58}, {0.025, 0.025, 0.26}, Swatch::dark_grey);
  shape.block({0.25, 0.345, 1.05}, {0.025, 0.025, 0.4}, Swatch::dark_grey);
  add(shape, Kind::appliance);
}

void Furniture::printer(const Spot& spot) {
  Shape shape(spot);
  shape.block({0, 0, 0.32}, {0.62, 0.58, 0.6}, Swatch::light_grey);
  for (const double z : {0.16, 0.34, 0.52}) shape.block({0, 0.295, z}, {0.56, 0.012, 0.14}, Swatch::white);
  shape.block({0, -0.05, 0.76}, {0.62, 0.48, 0.28}, Swatch::dark_grey);
  shape.block({0, -0.04, 0.96}, {0.62, 0.5, 0.12}, Swatch::light_grey);
  shape.block({0, 0.08, 0.645}, {0.4, 0.4, 0.02}, Swatch::white);
  shape.block({0.2, 0.23, 1.0}, {0.18, 0.12, 0.03}, Swatch::black);
  add(shape, Kind::appliance);
}

void Furniture::water_cooler(const Spot& spot) {
  Shape shape(spot);
  shape.block({0, 0, 0.5}, {0.32, 0.32, 1.0}, Swatch::white);
  shape.block({0, 0.165, 0.78}, {0.2, 0.01, 0.22}, Swatch::dark_grey);
  const std::array<Vec2d, 5> bottle{Vec2d(0.05, 1.0), Vec2d(0.13, 1.08), Vec2d(0.13, 1.32), Vec2d(0.1, 1.38), Vec2d(0.08, 1.39)};
  shape.turned({0, 0}, bottle, Swatch::blue, 16);
  add(shape, Kind::appliance);
}

void Furniture::bin(const Spot& spot) {
  Shape shape(spot);
  const std::array<Vec2d, 3> side{Vec2d(0.12, 0.0), Vec2d(0.15, 0.36), Vec2d(0.13, 0.362)};
  shape.turned({0, 0}, side, Swatch::dark_grey, 16);
  add(shape, Kind::appliance);
}

void Furniture::framed(const Spot& spot, double z, double across, double high, Swatch picture, Kind kind) {
  Shape shape(spot);
  shape.block({0, 0.015, z}, {across, 0.03, high}, kind == Kind::whiteboard ? Swatch::light_grey : Swatch::dark_grey);
  const double x = 0.5 * across - 0.03, low = z - 0.5 * high + 0.03, top = z + 0.5 * high - 0.03;
  shape.sheet({x, 0.033, low}, {-x, 0.033, low}, {-x, 0.033, top}, {x, 0.033, top}, picture);
  if (kind == Kind::whiteboard) shape.block({0, 0.06, low - 0.03}, {0.6 * across, 0.08, 0.02}, Swatch::light_grey);
  add(shape, kind);
}

void Furniture::pallet(const Spot& spot) {
  Shape shape(spot);
  shape.block({0, 0, 0.125}, {1.2, 0.8, 0.03}, Swatch::planks);
  for (const double y : {-0.34, 0.34}) shape.block({0, y, 0.055}, {1.2, 0.12, 0.11}, Swatch::planks);
  add(shape, Kind::pallet);
}

void Furniture::load(const Spot& spot, double high) {
  pallet(spot);
  Shape shape(spot);
  const double room = high - 0.14;
  switch (draws_.below(9)) {
    case 0:  // shrink-wrapped load
      shape.block({0, 0, 0.14 + 0.45 * room}, {1.14, 0.76, 0.9 * room}, Swatch::wrapped, Swatch::carton_plain);
      break;
    case 1: {  // a crate
      const double tall = 0.8 * room;
      shape.block({0, 0, 0.14 + 0.5 * tall}, {1.08, 0.7, tall}, Swatch::planks);
      for (const double z : {0.22, 0.06 + tall}) shape.block({0, 0, z}, {1.13, 0.75, 0.1}, Swatch::sand);
      break;
    }
    case 2: {  // bins
      constexpr std::array<Swatch, 4> kBins{Swatch::blue, Swatch::red, Swatch::grey, Swatch::teal};
      const Swatch paint = kBins[static_cast<std::size_t>(draws_.below(4))];
      const int layers = std::max(1, static_cast<int>(room / 0.42));
      for (int i = 0; i < layers; ++i) {
        shape.block({0, 0, 0.14 + 0.42 * i + 0.19}, {1.12, 0.76, 0.36}, paint, Swatch::dark_grey);
        shape.block({0, 0, 0.14 + 0.42 * i + 0.39}, {1.18, 0.8, 0.05}, paint, Swatch::dark_grey);
      }
      break;
    }
    case 3: {  // a few left
      const int count = 1 + draws_.below(3);
      for (int i = 0; i < count; ++i) {
        const double x = 0.4 * (i - 1), size = draws_.uniform(0.3, 0.37);
        shape.block({x, draws_.uniform(-0.15, 0.15), 0.14 + 0.5 * size}, {0.37, 0.5, size}, Swatch::carton_plain,
                    Swatch::carton_top);
      }
      break;
    }
    default: {  // layers of cartons
      const int layers = std::clamp(static_cast<int>(draws_.uniform(0.55, 1.0) * room / 0.42), 1, 3);
      const double tall = std::min(0.48, 0.95 * room / layers);
      for (int i = 0; i < layers; ++i) {
        const double aside = draws_.uniform(-0.015, 0.015);
        const bool is_last = i + 1 == layers;
        const double wide = is_last && draws_.below(2) == 0 ? 0.56 : 1.14;  // last layer may be half full
        shape.block({aside + (wide < 1.0 ? -0.28 : 0.0), aside, 0.14 + tall * (i + 0.5)}, {wide, 0.76, tall - 0.006},
                    Swatch::carton, Swatch::carton_top);
      }
    }
  }
  add(shape, Kind::carton);
}

void Furniture::cartons(const Spot& spot, int count) {
  Shape shape(spot);
  double z = 0.0;
  Vec2d at = Vec2d::Zero();
  for (int i = 0; i < count; ++i) {
    const Vec2d size = draws_.point({0.4, 0.35}, {0.6, 0.5});
    const double tall = draws_.uniform(0.28, 0.42);
    shape.block({at.x(), at.y(), z + 0.5 * tall}, {size.x(), size.y(), tall - 0.004}, Swatch::carton_plain, Swatch::carton_top);
    z += tall;
    at = draws_.point({-0.05, -0.04}, {0.05, 0.04});
  }
  add(shape, Kind::carton);
}

void Furniture::barrel(const Spot& spot, Swatch paint) {
  Shape shape(spot);
  const std::array<Vec2d, 9> side{Vec2d(0.29, 0.0), Vec2d(0.29, 0.28), Vec2d(0.3, 0.3),  Vec2d(0.29, 0.32), Vec2d(0.29, 0.57),
                                  Vec2d(0.3, 0.59), Vec2d(0.29, 0.61), Vec2d(0.3, 0.87), Vec2d(0.28, 0.88)};
  shape.turned({0, 0}, side, paint, 16);
  add(shape, Kind::barrel);
}

namespace {

void add_chassis(Shape& shape) {
  for (const double x : {-0.48, 0.48}) {
    for (const double y : {-0.62, 0.55}) {  // octagonal wheels, lying on their sides
      const double r = y < 0.0 ? 0.24 : 0.3;
      shape.cushion({x, y, r}, {0.2, 2.0 * r, 2.0 * r}, 0.09, Swatch::black);
    }
  }
  shape.cushion({0, -0.75, 0.65}, {1.06, 0.6, 0.78}, 0.1, Swatch::dark_grey);
  shape.cushion({0, 0.0, 0.48}, {1.0, 1.5, 0.42}, 0.05, Swatch::yellow);
  shape.cushion({0, -0.45, 0.9}, {0.96, 0.8, 0.3}, 0.06, Swatch::yellow);
}

}  // namespace

void Furniture::moving_forklift(const Spot& spot) {
  const auto add_object = [&](const auto& build) {
    Shape shape(spot);
    build(shape);
    add(shape, Kind::forklift);
  };
  add_object(add_chassis);
  add_object([](Shape& shape) {
    shape.block({0, -0.05, 1.1}, {0.9, 1.1, 0.14}, Swatch::yellow);
    shape.block({0, -0.05, 1.63}, {0.84, 1.02, 0.92}, Swatch::navy);
    for (const double x : {-0.42, 0.42}) {
      for (const double y : {-0.56, 0.46}) shape.block({x, y, 1.63}, {0.08, 0.08, 0.92}, Swatch::dark_grey);
    }
    shape.block({0, -0.05, 2.12}, {0.96, 1.16, 0.06}, Swatch::yellow);
  });
  add_object([](Shape& shape) {  // mast
    for (const double x : {-0.33, 0.33}) shape.block({x, 0.85, 1.15}, {0.1, 0.14, 2.2}, Swatch::dark_grey);
    for (const double z : {0.3, 1.0, 2.2}) shape.block({0, 0.88, z}, {0.76, 0.06, 0.1}, Swatch::dark_grey);
  });
  for (const double x : {-0.26, 0.26}) {
    add_object([x](Shape& shape) { shape.block({x, 1.5, 0.12}, {0.12, 1.1, 0.05}, Swatch::dark_grey); });
  }
}

void Furniture::forklift(const Spot& spot) {
  Shape shape(spot);
  add_chassis(shape);
  shape.cushion({0, -0.25, 1.1}, {0.5, 0.45, 0.14}, 0.04, Swatch::black);
  shape.cushion({0, -0.45, 1.38}, {0.46, 0.12, 0.5}, 0.04, Swatch::black);
  shape.block({0, 0.58, 0.95}, {0.9, 0.16, 0.6}, Swatch::yellow, Swatch::dark_grey);
  shape.rod({0, 0.45, 1.1}, {0, 0.25, 1.3}, 0.04, Swatch::black);
  shape.block({0, 0.19, 1.32}, {0.32, 0.05, 0.32}, Swatch::black);
  for (const double x : {-0.44, 0.44}) {  // overhead guard
    shape.rod({x, -0.62, 1.0}, {x, -0.5, 2.1}, 0.06, Swatch::dark_grey);
    shape.rod({x, 0.62, 1.2}, {x, 0.4, 2.1}, 0.06, Swatch::dark_grey);
    shape.rod({x, -0.55, 2.1}, {x, 0.42, 2.1}, 0.06, Swatch::dark_grey);
    shape.block({0.75 * x, 0.85, 1.15}, {0.1, 0.14, 2.2}, Swatch::dark_grey);  // mast
    shape.block({0.6 * x, 1.5, 0.12}, {0.12, 1.1, 0.05}, Swatch::dark_grey);   // forks
    shape.block({0.6 * x, 0.95, 0.4}, {0.12, 0.05, 0.6}, Swatch::dark_grey);
  }
  for (const double y : {-0.5, -0.27, -0.04, 0.19, 0.42}) shape.rod({-0.44, y, 2.1}, {0.44, y, 2.1}, 0.04, Swatch::dark_grey);
  for (const double z : {0.3, 1.0, 2.2}) shape.block({0, 0.88, z}, {0.76, 0.06, 0.1}, Swatch::dark_grey);
  shape.block({0, -1.06, 0.65}, {0.8, 0.01, 0.2}, Swatch::stripes);
  add(shape, Kind::forklift);
}

void Furniture::conveyor(const Spot& spot, double deep) {
  Shape shape(spot);
  shape.block({0, 0, 0.78}, {0.62, deep, 0.06}, Swatch::dark_grey);
  for (const double x : {-0.34, 0.34}) shape.block({x, 0, 0.8}, {0.06, deep, 0.16}, Swatch::blue);
  const int legs = std::max(2, static_cast<int>(deep / 1.6) + 1);
  for (int i = 0; i < legs; ++i) {
    const double y = (deep - 0.3) * (static_cast<double>(i) / (legs - 1) - 0.5);
    for (const double x : {-0.32, 0.32}) shape.block({x, y, 0.37}, {0.06, 0.06, 0.74}, Swatch::steel);
    shape.block({0, y, 0.25}, {0.6, 0.04, 0.04}, Swatch::steel);
  }
  for (double y = -0.5 * deep + 0.1; y < 0.5 * deep - 0.05; y += 0.2) {
    shape.rod({-0.31, y, 0.83}, {0.31, y, 0.83}, 0.06, Swatch::steel);
  }
  add(shape, Kind::conveyor);
  for (double y = -0.5 * deep + draws_.uniform(0.4, 1.2); y < 0.5 * deep - 0.4; y += draws_.uniform(0.8, 2.2)) {
    Spot on = within(spot, draws_.uniform(-0.04, 0.04), y);
    on.floor += 0.865;
    cartons(on, 1);
  }
}

void Furniture::workbench(const Spot& spot) {
  Shape shape(spot);
  shape.block({0, 0, 0.88}, {2.0, 0.8, 0.05}, Swatch::planks);
  for (const double x : {-0.94, 0.94}) {
    for (const double y : {-0.34, 0.34}) shape.block({x, y, 0.43}, {0.06, 0.06, 0.86}, Swatch::blue);
    shape.block({x, -0.37, 1.4}, {0.05, 0.05, 1.0}, Swatch::blue);
  }
  shape.block({0, 0, 0.25}, {1.86, 0.7, 0.03}, Swatch::steel);
  shape.block({0, -0.37, 1.45}, {1.86, 0.02, 0.7}, Swatch::light_grey);
  shape.block({0, -0.25, 1.83}, {1.9, 0.26, 0.03}, Swatch::steel);
  for (int i = 0; i < 4; ++i) {
    shape.block({-0.7 + 0.42 * i, -0.25, 1.94}, {0.3, 0.22, 0.18}, any_color());
    const double z = draws_.uniform(1.3, 1.6), high = draws_.uniform(0.15, 0.3);
    shape.block({-0.6 + 0.4 * i, -0.35, z}, {0.05, 0.02, high}, any_color());
  }
  shape.block({0.55, -0.05, 1.04}, {0.4, 0.3, 0.26}, Swatch::carton_plain, Swatch::carton_top);
  add(shape, Kind::table);
}

}  // namespace flockstep::indoors
