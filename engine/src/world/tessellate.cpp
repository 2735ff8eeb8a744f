#include "world/tessellate.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iomanip>
#include <numbers>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

// Appends triangles of one primitive, given in its local frame, to a mesh.
class Patch {
 public:
  Patch(const Primitive& primitive, TriangleMesh& mesh) : primitive_(primitive), mesh_(mesh) {}

  std::int32_t vertex(const Eigen::Vector3d& local) {
    const Eigen::Vector3d world = primitive_.rotation.cast<double>() * local + primitive_.center.cast<double>();
    mesh_.vertices.push_back(world.cast<float>());
    return static_cast<std::int32_t>(mesh_.vertices.size()) - 1;
  }

  void triangle(std::int32_t a, std::int32_t b, std::int32_t c) {
    mesh_.triangles.push_back({a, b, c});
    mesh_.materials.push_back(primitive_.material);
  }

  void quad(std::int32_t a, std::int32_t b, std::int32_t c, std::int32_t d) {
    triangle(a, b, c);
    triangle(a, c, d);
  }

 private:
  const Primitive& primitive_;
  TriangleMesh& mesh_;
};

// Returns the angle whose arc of radius r rises r (1 - cos(angle / 2)) = error above its chord: 1 - cos(x) = 2 sin^2(x / 2).
double arc_within(double radius, double error) { return 4.0 * std::asin(std::sqrt(std::min(error / (2.0 * radius), 0.5))); }

int parts(double whole, double part, int least) { return std::max(least, static_cast<int>(std::ceil(whole / part))); }

void add_box(Patch patch, const Vec3& half_extents, bool facing_inward) {
  std::array<std::int32_t, 8> corner{};  // bit 0: +x, bit 1: +y, bit 2: +z
  for (unsigned i = 0; i < 8; ++i) {
    const Eigen::Vector3d sign((i & 1U) != 0 ? 1.0 : -1.0, (i & 2U) != 0 ? 1.0 : -1.0, (i & 4U) != 0 ? 1.0 : -1.0);
    corner[i] = patch.vertex(sign.cwiseProduct(half_extents.cast<double>()));
  }
  constexpr std::array<std::array<std::size_t, 4>, 6> kFaces{
      {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}}};  // counter-clockwise from outside
  for (const auto& [a, b, c, d] : kFaces) {
    if (facing_inward) {
      patch.quad(corner[d], corner[c], corner[b], corner[a]);
    } else {
      patch.quad(corner[a], corner[b], corner[c], corner[d]);
    }
  }
}

void add_cylinder(Patch patch, double radius, double half_height, double chord_error) {
  const int sides = parts(2.0 * std::numbers::pi, arc_within(radius, chord_error), 8);
  const std::int32_t bottom = patch.vertex({0.0, 0.0, -half_height});
  const std::int32_t top = patch.vertex({0.0, 0.0, half_height});
  const std::int32_t rim = top + 1;  // bottom and top vertex of each side in turn
  for (int i = 0; i < sides; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / sides;
    patch.vertex({radius * std::cos(angle), radius * std::sin(angle), -half_height});
    patch.vertex({radius * std::cos(angle), radius * std::sin(angle), half_height});
  }
  for (int i = 0; i < sides; ++i) {
    const std::int32_t here = rim + 2 * i;
    const std::int32_t next = rim + 2 * ((i + 1) % sides);
    patch.quad(here, next, next + 1, here + 1);
    patch.triangle(bottom, next, here);
    patch.triangle(top, here + 1, next + 1);
  }
}

void add_disc(Patch patch, double radius, double chord_error) {
  const int sides = parts(2.0 * std::numbers::pi, arc_within(radius, chord_error), 8);
  const std::int32_t middle = patch.vertex({0.0, 0.0, 0.0});
  for (int i = 0; i < sides; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / sides;
    patch.vertex({radius * std::cos(angle), radius * std::sin(angle), 0.0});
  }
  for (int i = 0; i < sides; ++i) patch.triangle(middle, middle + 1 + i, middle + 1 + (i + 1) % sides);
}

// Adds two half balls around (0, 0, -+middle) and the cylinder between them; a ball if middle is 0. In rings of latitude, a
// cell of equal steps in latitude and longitude is a planar trapezoid inscribed in a circle. The circle is widest at the
// equator, where its angular radius is half the cell's diagonal, step / sqrt(2).
void add_capsule(Patch patch, double radius, double middle, double chord_error) {
  const double step = arc_within(radius, chord_error) / std::numbers::sqrt2;
  const int half_rings = parts(std::numbers::pi / 2.0, step, 2);
  const int sides = parts(2.0 * std::numbers::pi, step, 8);
  const std::int32_t south = patch.vertex({0.0, 0.0, -middle - radius});
  const std::int32_t north = patch.vertex({0.0, 0.0, middle + radius});
  const std::int32_t first = north + 1;
  int rings = 0;
  const auto add_ring = [&](int i, double z) {
    Interrupt::poll();
    const double latitude = std::numbers::pi / 2.0 * i / half_rings;
    for (int j = 0; j < sides; ++j) {
      const double longitude = 2.0 * std::numbers::pi * j / sides;
      const double across = radius * std::cos(latitude);
      patch.vertex({across * std::cos(longitude), across * std::sin(longitude), z + radius * std::sin(latitude)});
    }
    ++rings;
  };
  for (int i = 1 - half_rings; i <= 0; ++i) add_ring(i, -middle);
  for (int i = middle > 0.0 ? 0 : 1; i < half_rings; ++i) add_ring(i, middle);
  for (int j = 0; j < sides; ++j) {
    Interrupt::poll();
    const int next = (j + 1) % sides;
    const std::int32_t last = first + (rings - 1) * sides;
    patch.triangle(south, first + next, first + j);
    patch.triangle(north, last + j, last + next);
    for (int i = 0; i + 1 < rings; ++i) {
      const std::int32_t ring = first + i * sides;
      patch.quad(ring + j, ring + next, ring + sides + next, ring + sides + j);
    }
  }
}

constexpr double kMaxTriangles = 1e8;  // about 4 GB

std::string rounded(double value) {
  std::ostringstream text;
  text << std::setprecision(2) << value;
  return text.str();
}

// Estimates the number of triangles of a primitive, as a double because it may exceed the range of int.
double triangles_of(const Primitive& primitive, double chord_error) {
  constexpr double kTurn = 2.0 * std::numbers::pi;
  const double radius = primitive.half_extents.x();
  const double arc = arc_within(radius, chord_error);
  switch (primitive.kind) {
    case PrimitiveKind::cylinder:
      return 4.0 * std::max(8.0, kTurn / arc);
    case PrimitiveKind::disc:
      return std::max(8.0, kTurn / arc);
    case PrimitiveKind::sphere:
    case PrimitiveKind::capsule: {
      const double sides = std::max(8.0, std::numbers::sqrt2 * kTurn / arc);
      return sides * sides;  // half as many rings as sides, two triangles a cell
    }
    default:
      return 12.0;
  }
}

}  // namespace

TriangleMesh tessellate(const SceneDescription& description, float chord_error_m, std::vector<std::int32_t>* all_objects) {
  require(chord_error_m >= 1e-6F, "chord_error_m", "a number >= 1e-06", std::to_string(chord_error_m));
  double count = static_cast<double>(description.mesh.triangles.size());
  for (const Primitive& primitive : description.primitives) count += triangles_of(primitive, chord_error_m);
  require(count <= kMaxTriangles, "chord_error_m", "a number that needs at most 1e+08 triangles",
          std::to_string(chord_error_m) + ", which needs " + rounded(count));
  TriangleMesh mesh;
  std::vector<std::int32_t> objects;
  const std::size_t num_primitives = description.primitives.size();
  for (std::size_t i = 0; i < num_primitives; ++i) {
    Interrupt::poll();
    const Primitive& primitive = description.primitives[i];
    const Vec3& half = primitive.half_extents;
    Patch patch(primitive, mesh);
    switch (primitive.kind) {
      case PrimitiveKind::room:
        add_box(patch, half, true);
        break;
      case PrimitiveKind::box:
        add_box(patch, half, false);
        break;
      case PrimitiveKind::cylinder:
        add_cylinder(patch, half.x(), half.z(), chord_error_m);
        break;
      case PrimitiveKind::sphere:
      case PrimitiveKind::capsule:
        add_capsule(patch, half.x(), half.z() - half.x(), chord_error_m);
        break;
      case PrimitiveKind::plane: {
        const std::int32_t a = patch.vertex({-half.x(), -half.y(), 0.0});
        const std::int32_t b = patch.vertex({half.x(), -half.y(), 0.0});
        const std::int32_t c = patch.vertex({half.x(), half.y(), 0.0});
        patch.quad(a, b, c, patch.vertex({-half.x(), half.y(), 0.0}));
        break;
      }
      case PrimitiveKind::disc:
        add_disc(patch, half.x(), chord_error_m);
        break;
    }
    objects.resize(mesh.triangles.size(), static_cast<std::int32_t>(i));
  }
  const auto first_vertex = static_cast<std::int32_t>(mesh.vertices.size());
  const TriangleMesh& rest = description.mesh;
  mesh.vertices.insert(mesh.vertices.end(), rest.vertices.begin(), rest.vertices.end());
  mesh.materials.insert(mesh.materials.end(), rest.materials.begin(), rest.materials.end());
  if (!rest.uv.empty()) {
    mesh.uv.resize(static_cast<std::size_t>(first_vertex));
    mesh.uv.insert(mesh.uv.end(), rest.uv.begin(), rest.uv.end());
  }
  for (const auto& [a, b, c] : rest.triangles) {
    mesh.triangles.push_back({a + first_vertex, b + first_vertex, c + first_vertex});
  }
  std::size_t num_objects = num_primitives;
  for (std::size_t i = 0; i < rest.triangles.size(); ++i) {
    const std::size_t object = num_primitives + (rest.objects.empty() ? 0U : rest.objects[i]);
    objects.push_back(static_cast<std::int32_t>(object));
    num_objects = std::max(num_objects, object + 1);
  }
  if (num_objects <= kMaxObjects) {
    mesh.objects.reserve(objects.size());
    for (const std::int32_t object : objects) mesh.objects.push_back(static_cast<std::uint16_t>(object));
  }
  if (all_objects != nullptr) *all_objects = std::move(objects);
  return mesh;
}

namespace {

using Vec3d = Eigen::Vector3d;
using Quatd = Eigen::Quaterniond;

// Cosines of k pi / 16 for k = 0 to 8. The functions of the C library may differ in the last bit between machines.
constexpr std::array<double, 9> kCosines{1.0,
                                         0.98078528040323044913,
                                         0.92387953251128675613,
                                         0.83146961230254523708,
                                         0.70710678118654752440,
                                         0.55557023301960222474,
                                         0.38268343236508977173,
                                         0.19509032201612826785,
                                         0.0};
static_assert(kRingBars == 16);

// Cosine and sine of k pi / 16 for k = 0 to 31.
double cosine(std::size_t k) {
  k = std::min(k, 32 - k);
  return k <= 8 ? kCosines[k] : -kCosines[16 - k];
}
double sine(std::size_t k) { return cosine((k + 24) % 32); }

class FrameBars {
 public:
  FrameBars(const Gate& gate, std::vector<Primitive>& bars)
      : gate_(gate), turn_(gate.rotation.cast<double>()), bars_(bars), inside_(gate.size / 2.0), half_bar_(gate.bar / 2.0) {}

  // The bars above and below reach over the ends of those at the sides.
  void add_square() {
    const double away = inside_ + half_bar_;
    for (const double side : {-away, away}) {
      add(PrimitiveKind::box, {0.0, 0.0, side}, Quatd::Identity(), {half_bar_, inside_ + 2.0 * half_bar_, half_bar_});
      add(PrimitiveKind::box, {0.0, side, 0.0}, Quatd::Identity(), {half_bar_, half_bar_, inside_});
    }
  }

  // A regular polygon. The middles of its bars are closest to the centre and touch the opening.
  void add_ring() {
    const double away = inside_ + half_bar_;
    const double half_length = away * sine(1) / cosine(1);
    for (std::size_t i = 0; i < kRingBars; ++i) {
      const Quatd along(cosine(i), sine(i), 0.0, 0.0);  // turns z by i / 16 of a turn about x
      add(PrimitiveKind::capsule, {0.0, away * cosine(2 * i), away * sine(2 * i)}, along,
          {half_bar_, half_bar_, half_length + half_bar_});
    }
  }

 private:
  void add(PrimitiveKind kind, const Vec3d& center, const Quatd& rotation, const Vec3d& half) {
    bars_.push_back({.kind = kind,
                     .center = (gate_.center.cast<double>() + turn_ * center).cast<float>(),
                     .rotation = (turn_ * rotation).normalized().cast<float>(),
                     .half_extents = half.cast<float>(),
                     .material = gate_.material,
                     .visibility = gate_.visibility});
  }

  const Gate& gate_;
  Quatd turn_;
  std::vector<Primitive>& bars_;
  double inside_, half_bar_;  // m
};

}  // namespace

void append_frame(const Gate& gate, std::vector<Primitive>& bars) {
  FrameBars frame(gate, bars);
  if (gate.shape == GateShape::ring) {
    frame.add_ring();
  } else {
    frame.add_square();
  }
}

std::vector<Primitive> with_frames(const SceneDescription& description) {
  if (description.gates.empty()) return {};
  std::vector<Primitive> all = description.primitives;
  for (const Gate& gate : description.gates) append_frame(gate, all);
  std::ranges::stable_sort(all, {}, &Primitive::kind);
  return all;
}

}  // namespace flockstep
