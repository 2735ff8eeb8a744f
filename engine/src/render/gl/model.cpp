#include "render/gl/model.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <span>
#include <unordered_map>

#include "flockstep/body.hpp"
#include "render/appearance.hpp"
#include "trace/bodies.hpp"
#include "trace/masks.hpp"

namespace flockstep::render {
namespace {

using Vec3d = Eigen::Vector3d;

constexpr std::size_t kChunkTriangles = 256;

std::array<float, 3> array_of(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

// Returns the light of the models of mesh bodies; see Paint.
Light light_of_bodies() {
  Light light;
  light.sun_color = {1.0F, 1.0F, 1.0F};
  light.sky_ambient = light.ground_ambient = {0.0F, 0.0F, 0.0F};
  return light;
}

// Returns the colour of a surface as written to images; see Light.
std::uint32_t shade(const Light& light, const Surface& surface, const Vec3d& normal, bool sun) {
  double facing = 0.0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    facing += normal[static_cast<Eigen::Index>(axis)] * static_cast<double>(light.sun_direction[axis]);
  }
  const double above = 0.5 * (1.0 + normal.z());
  std::uint32_t packed = 0xFF000000U;
  for (std::size_t i = 0; i < 3; ++i) {
    const double ambient = static_cast<double>(light.ground_ambient[i]) +
                           above * (static_cast<double>(light.sky_ambient[i]) - static_cast<double>(light.ground_ambient[i]));
    const double direct = sun ? static_cast<double>(light.sun_color[i]) * std::max(0.0, facing) : 0.0;
    const double reflected = static_cast<double>(surface.color[i]) * (direct + ambient);
    const double value = std::min(1.0, reflected + static_cast<double>(surface.emissive[i]));
    const double written = std::floor(255.0 * std::pow(value, 1.0 / static_cast<double>(light.gamma)) + 0.5);
    packed |= static_cast<std::uint32_t>(written) << (8U * static_cast<std::uint32_t>(i));
  }
  return packed;
}

// A triangle before sorting.
struct Triangle {
  std::array<std::uint32_t, 3> corners;  // indices into Soup::positions
  Vec3 normal;                           // unit
  Surface surface;
  float density;        // texels per square metre
  std::uint32_t paint;  // as in PaintedVertex
  Vec3 middle;          // m, centre of its bounding box
  float size = 0.0;     // m, longest side of its bounding box
};

struct Soup {
  std::vector<Vec3> positions;
  bool is_painted = false;                   // true if any triangle is painted
  std::vector<std::array<float, 2>> uv;      // one per position if is_painted
  std::vector<std::array<float, 3>> colors;  // one per position if is_painted
  std::vector<Triangle> triangles;

  std::uint32_t add(const Vec3& position) {
    positions.push_back(position);
    return static_cast<std::uint32_t>(positions.size() - 1);
  }

  void add(const std::array<std::uint32_t, 3>& corners, const Vec3d& normal, const Surface& surface, float density = 0.0F,
           std::uint32_t paint = 0) {
    const Vec3& a = positions[corners[0]];
    const Vec3& b = positions[corners[1]];
    const Vec3& c = positions[corners[2]];
    const Vec3 low = a.cwiseMin(b).cwiseMin(c);
    const Vec3 high = a.cwiseMax(b).cwiseMax(c);
    triangles.push_back({corners, normal.cast<float>(), surface, density, paint, 0.5F * (low + high), (high - low).maxCoeff()});
  }
};

// Adds the faces of a room or a box, or the single face of a plane.
void add_flat(const Primitive& primitive, const Surface& surface, std::uint32_t paint, Soup& soup) {
  const Eigen::Matrix3d rotation = primitive.rotation.cast<double>().normalized().toRotationMatrix();
  const Vec3d center = primitive.center.cast<double>();
  const Vec3d half = primitive.half_extents.cast<double>();
  const auto corner = [&](const Vec3d& local) { return soup.add((center + rotation * local.cwiseProduct(half)).cast<float>()); };
  std::array<std::uint32_t, 8> corners{};
  for (std::size_t i = 0; i < 8; ++i)
    corners[i] = corner({i % 2 == 0 ? -1.0 : 1.0, i / 2 % 2 == 0 ? -1.0 : 1.0, i / 4 == 0 ? -1.0 : 1.0});
  const auto face = [&](std::size_t axis, std::size_t side) {
    const std::size_t u = std::size_t{1} << ((axis + 1) % 3);
    const std::size_t v = std::size_t{1} << ((axis + 2) % 3);
    const std::size_t base = side << axis;
    const Vec3d normal = rotation.col(static_cast<Eigen::Index>(axis)) * (side == 1 ? 1.0 : -1.0);
    soup.add({corners[base], corners[base + u], corners[base + u + v]}, normal, surface, 0.0F, paint);
    soup.add({corners[base], corners[base + u + v], corners[base + v]}, normal, surface, 0.0F, paint);
  };
  if (primitive.kind == PrimitiveKind::plane) {
    face(2, 1);
    return;
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    face(axis, 0);
    face(axis, 1);
  }
}

// paints_all: paint all triangles.
void add_mesh(const World& world, const Appearance& appearance, bool paints_all, Soup& soup) {
  const TriangleMesh& mesh = world.triangles();
  const std::vector<float> densities = texels_per_square_metre(world);
  const auto base = static_cast<std::uint32_t>(soup.positions.size());
  soup.positions.insert(soup.positions.end(), mesh.vertices.begin(), mesh.vertices.end());
  constexpr std::array<float, 3> kWhite{1.0F, 1.0F, 1.0F};
  soup.is_painted = !mesh.uv.empty() || !mesh.colors.empty() || paints_all;
  if (soup.is_painted) {
    soup.uv.resize(base);
    soup.uv.insert(soup.uv.end(), mesh.uv.begin(), mesh.uv.end());
    soup.uv.resize(soup.positions.size());
    soup.colors.resize(base, kWhite);
    soup.colors.insert(soup.colors.end(), mesh.colors.begin(), mesh.colors.end());
    soup.colors.resize(soup.positions.size(), kWhite);
  }
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!is_visible(mesh.visibility_of(i))) continue;
    std::array<std::uint32_t, 3> corners{};
    std::array<Vec3d, 3> at;
    for (std::size_t k = 0; k < 3; ++k) {
      corners[k] = base + static_cast<std::uint32_t>(mesh.triangles[i][k]);
      at[k] = soup.positions[corners[k]].cast<double>();
    }
    const Vec3d normal = (at[1] - at[0]).cross(at[2] - at[0]);
    if (!(normal.norm() > 0.0)) continue;  // a triangle without area is invisible
    Surface surface = appearance.materials[mesh.materials[i]];
    surface.instance = static_cast<std::uint16_t>(appearance.first_object + mesh.objects[i]);
    const bool is_painted = soup.is_painted && (paints_all || surface.texture >= 0 ||
                                                std::any_of(corners.begin(), corners.end(),
                                                            [&](std::uint32_t corner) { return soup.colors[corner] != kWhite; }));
    soup.add(corners, normal.normalized(), surface, densities.empty() ? 0.0F : densities[i],
             is_painted ? mesh.materials[i] + 1U : 0U);
  }
}

// Sorts triangles so that neighbours lie close together. Splits them along the longest axis until each part fits into a
// chunk.
void sort_by_place(std::span<Triangle> triangles) {
  if (triangles.size() <= kChunkTriangles) return;
  Vec3 low = triangles[0].middle;
  Vec3 high = low;
  for (const Triangle& triangle : triangles) {
    low = low.cwiseMin(triangle.middle);
    high = high.cwiseMax(triangle.middle);
  }
  Eigen::Index axis = 0;
  (high - low).maxCoeff(&axis);
  // The left part is a whole number of chunks, so only the last chunk on the right is partly filled.
  const std::size_t chunks = (triangles.size() + kChunkTriangles - 1) / kChunkTriangles;
  const std::size_t left = chunks / 2 * kChunkTriangles;
  std::nth_element(triangles.begin(), triangles.begin() + static_cast<std::ptrdiff_t>(left), triangles.end(),
                   [&](const Triangle& a, const Triangle& b) { return a.middle[axis] < b.middle[axis]; });
  sort_by_place(triangles.first(left));
  sort_by_place(triangles.subspan(left));
}

// Puts large triangles first. Mixed with small ones, they would enlarge the bounding boxes of those chunks.
void sort_for_chunks(std::vector<Triangle>& triangles) {
  if (triangles.size() <= kChunkTriangles) return;
  std::vector<float> sizes;
  for (const Triangle& triangle : triangles) sizes.push_back(triangle.size);
  const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  const float large = 16.0F * *middle;
  const auto small = std::stable_partition(triangles.begin(), triangles.end(), [&](const auto& t) { return t.size > large; });
  const auto num_large = static_cast<std::size_t>(small - triangles.begin());
  sort_by_place(std::span(triangles).first(num_large));
  sort_by_place(std::span(triangles).subspan(num_large));
}

// The vertices of one chunk. Each is the last corner of at most one triangle.
class Corners {
 public:
  Corners(const Soup& soup, std::vector<FlatVertex>& vertices, std::vector<PaintedVertex>& painted)
      : soup_(soup), vertices_(vertices), painted_(painted) {}

  void start_chunk() { copies_.clear(); }

  // Returns the indices of the triangle and stores its attributes at the last one.
  std::array<std::uint32_t, 3> add(const Triangle& triangle, const Light& light) {
    std::array<std::uint32_t, 3> corners = triangle.corners;
    const auto is_free = [&](std::uint32_t corner) {
      const auto found = copies_.find(corner);
      return found == copies_.end() || !found->second.taken;
    };
    for (int turn = 0; turn < 3 && !is_free(corners[2]); ++turn) std::rotate(corners.begin(), corners.begin() + 1, corners.end());
    std::array<std::uint32_t, 3> indices{vertex(corners[0]), vertex(corners[1]), 0};
    if (is_free(corners[2])) {
      indices[2] = vertex(corners[2]);
      copies_[corners[2]].taken = true;
    } else {
      indices[2] = append(corners[2]);  // a copy used only by this triangle
    }
    FlatVertex& last = vertices_[indices[2]];
    const Vec3d normal = triangle.normal.cast<double>();
    last.normal = array_of(triangle.normal);
    const auto both_sides = [&](bool sun) -> std::array<std::uint32_t, 2> {
      return {shade(light, triangle.surface, normal, sun), shade(light, triangle.surface, -normal, sun)};
    };
    last.sunlit = both_sides(true);
    last.shadowy = both_sides(false);
    last.ids = pack_ids(triangle.surface);
    if (soup_.is_painted) {
      painted_[indices[2]].density = triangle.density;
      painted_[indices[2]].paint = triangle.paint;
    }
    return indices;
  }

 private:
  struct Copy {
    std::uint32_t vertex = 0;
    bool taken = false;  // it is the last corner of a triangle
  };

  std::uint32_t vertex(std::uint32_t corner) {
    const auto [found, is_new] = copies_.try_emplace(corner);
    if (is_new) found->second.vertex = append(corner);
    return found->second.vertex;
  }

  std::uint32_t append(std::uint32_t corner) {
    vertices_.push_back({});
    vertices_.back().position = array_of(soup_.positions[corner]);
    if (soup_.is_painted) painted_.push_back({soup_.uv[corner], 0.0F, 0, soup_.colors[corner], 0.0F});
    return static_cast<std::uint32_t>(vertices_.size() - 1);
  }

  const Soup& soup_;
  std::vector<FlatVertex>& vertices_;
  std::vector<PaintedVertex>& painted_;
  std::unordered_map<std::uint32_t, Copy> copies_;
};

void make_chunks(const Soup& soup, const Light& light, GlModel& model) {
  Corners corners(soup, model.vertices, model.painted);
  for (std::size_t first = 0; first < soup.triangles.size(); first += kChunkTriangles) {
    const auto chunk = std::span(soup.triangles).subspan(first, std::min(kChunkTriangles, soup.triangles.size() - first));
    const auto first_index = static_cast<std::uint32_t>(model.indices.size());
    Eigen::AlignedBox3f box;
    corners.start_chunk();
    for (const Triangle& triangle : chunk) {
      for (const std::uint32_t corner : triangle.corners) box.extend(soup.positions[corner]);
      const auto indices = corners.add(triangle, light);
      model.indices.insert(model.indices.end(), indices.begin(), indices.end());
    }
    model.chunks.push_back({box.center(), 0.5F * box.sizes(), first_index, static_cast<std::uint32_t>(3 * chunk.size())});
  }
}

// Sets the light terms of a RoundShape or a Paint from a surface and the light.
template <class Record>
void set_light(Record& record, const Surface& surface, const Light& light) {
  record.gamma_exponent = 1.0F / light.gamma;
  for (std::size_t i = 0; i < 3; ++i) {
    record.middle[i] = 0.5F * surface.color[i] * (light.sky_ambient[i] + light.ground_ambient[i]) + surface.emissive[i];
    record.slope[i] = 0.5F * surface.color[i] * (light.sky_ambient[i] - light.ground_ambient[i]);
    record.sun[i] = surface.color[i] * light.sun_color[i];
  }
  record.sun_direction = light.sun_direction;
}

Mat3 rotation_of(const Primitive& primitive) {
  return primitive.rotation.cast<double>().normalized().toRotationMatrix().cast<float>();
}

void add_round(RoundKind kind, const Primitive& primitive, const Surface& surface, bool only_front, GlModel& model) {
  RoundShape shape = make_round_shape(primitive, surface, model.light);
  shape.only_front = only_front ? 1.0F : 0.0F;
  model.shapes[static_cast<std::size_t>(kind)].push_back(shape);
  model.bounds[static_cast<std::size_t>(kind)].push_back(make_round_bound(kind, primitive));
}

}  // namespace

std::uint32_t pack_ids(const Surface& surface) {
  return static_cast<std::uint32_t>(surface.semantic) | (static_cast<std::uint32_t>(surface.instance) << 16U);
}

RoundShape make_round_shape(const Primitive& primitive, const Surface& surface, const Light& light) {
  const Mat3 rotation = rotation_of(primitive);
  RoundShape shape{};
  shape.center = array_of(primitive.center);
  shape.radius = primitive.half_extents.x();
  shape.axis_x = array_of(rotation.col(0));
  shape.axis_y = array_of(rotation.col(1));
  shape.axis_z = array_of(rotation.col(2));
  shape.half_height = primitive.half_extents.z();
  set_light(shape, surface, light);
  shape.half_y = primitive.half_extents.y();
  shape.ids = pack_ids(surface);
  return shape;
}

RoundBound make_round_bound(RoundKind kind, const Primitive& primitive) {
  const Vec3& half = primitive.half_extents;
  const float reach = kind == RoundKind::box        ? half.norm()
                      : kind == RoundKind::cylinder ? std::hypot(half.x(), half.z())
                                                    : std::max(half.x(), half.z());
  return {primitive.center, rotation_of(primitive).col(2), half.x(), reach};
}

GlModel::GlModel(const World& world, Of of) : textures(world) {
  Appearance appearance(world);
  if (of == Of::mesh_body) {
    appearance.light = light_of_bodies();
    appearance.markers.clear();
  }
  light = appearance.light;
  Soup soup;
  // Air that is not clear changes the linear colour of each pixel, so all flat geometry is painted. Primitives show no textures:
  // the paints without textures follow those of the materials.
  const bool has_air = !Air(light).is_clear();
  const std::size_t num_materials = appearance.materials.size();
  for (std::size_t i = 0; i < world.primitives().size(); ++i) {
    const Primitive& primitive = world.primitives()[i];
    if (!is_visible(primitive.visibility)) continue;
    const Surface& surface = appearance.primitives[i];
    const auto round = [&](RoundKind kind) { add_round(kind, primitive, surface, false, *this); };
    switch (primitive.kind) {
      case PrimitiveKind::room:
        rooms.push_back({primitive.center - primitive.half_extents, primitive.center + primitive.half_extents});
        [[fallthrough]];
      case PrimitiveKind::box:
      case PrimitiveKind::plane:
        add_flat(primitive, surface, has_air ? static_cast<std::uint32_t>(num_materials + primitive.material + 1) : 0U, soup);
        break;
      case PrimitiveKind::cylinder:
        round(RoundKind::cylinder);
        break;
      case PrimitiveKind::sphere:
        round(RoundKind::sphere);
        break;
      case PrimitiveKind::capsule:
        round(RoundKind::capsule);
        break;
      case PrimitiveKind::disc:
        round(RoundKind::disc);
        break;
    }
  }
  add_mesh(world, appearance, has_air || of == Of::mesh_body, soup);
  for (const MarkerSphere& marker : appearance.markers) {
    Primitive sphere;
    sphere.kind = PrimitiveKind::sphere;
    sphere.center = marker.center;
    sphere.half_extents = Vec3::Constant(appearance.marker_radius);
    add_round(RoundKind::sphere, sphere, marker.surface, true, *this);
  }
  const std::vector<bool> masking = trace::masking_materials(world);
  for (std::size_t i = 0; soup.is_painted && i < num_materials; ++i) {
    Paint& paint = paints.emplace_back();
    set_light(paint, appearance.materials[i], light);
    paint.texture = static_cast<float>(appearance.materials[i].texture + 1);
    if (masking[i]) paint.cutoff = 255.0F * world.materials()[i].alpha_cutoff;
    masked |= masking[i];
  }
  for (std::size_t i = 0; has_air && i < num_materials; ++i) set_light(paints.emplace_back(), appearance.materials[i], light);
  sort_for_chunks(soup.triangles);
  make_chunks(soup, light, *this);
}

namespace {

RoundKind round_kind_of(PrimitiveKind kind) {
  switch (kind) {
    case PrimitiveKind::cylinder:
      return RoundKind::cylinder;
    case PrimitiveKind::sphere:
      return RoundKind::sphere;
    case PrimitiveKind::capsule:
      return RoundKind::capsule;
    default:
      return RoundKind::box;
  }
}

}  // namespace

void append_bodies(const VisibleBodies& bodies, const World& world, bool shadows,
                   const std::function<std::uint32_t(const std::shared_ptr<const World>&)>& model_of, GlBodies& out) {
  if (bodies.shapes.count == 0) return;
  const Eigen::Matrix3d to_sun = sun_rotation(world.light());
  for (std::size_t i = 0; i < bodies.shapes.count; ++i) {
    if (bodies.shapes.radius[i] < 0.0F) continue;  // the drone that carries the camera is hidden later; see TileCamera
    const BodySurface& appearance = bodies.surface(i);
    const Surface surface{.color = appearance.color, .semantic = appearance.semantic, .instance = bodies.instance(i)};
    if (const std::shared_ptr<const World>* const mesh = appearance.mesh) {
      const trace::PosedMesh posed = trace::posed_mesh(bodies.shapes, i);
      const Mat3 rotation = posed.to_local.transpose();
      out.meshes.push_back({model_of(*mesh), posed.position, rotation, posed.radius, pack_ids(surface),
                            shadows ? make_mesh_caster(posed.position, rotation, posed.radius, to_sun) : SunCaster{}});
      continue;
    }
    const Primitive solid = trace::posed_solid(bodies.shapes, i);
    const RoundKind kind = round_kind_of(solid.kind);
    out.solids.push_back({kind, make_round_shape(solid, surface, world.light()), make_round_bound(kind, solid),
                          shadows ? make_caster(solid, to_sun) : SunCaster{}});
  }
}

}  // namespace flockstep::render
