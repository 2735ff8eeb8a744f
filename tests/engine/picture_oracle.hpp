// An independent reference for rendered pixels in double precision: closed forms, all triangles, and the shading formula above
// struct Light. It shares no code with the engine's rendering, tracing or tables.
#pragma once

#include <set>

#include "batch_helpers.hpp"
#include "ray_oracle.hpp"

namespace flockstep::oracle {

// -- Pixel directions.

struct Eye {
  Vec3d origin;
  Eigen::Matrix3d rotation;  // camera to world
};

inline Eigen::Matrix3d matrix_of(const float* wxyz) {
  return Eigen::Quaterniond(wxyz[0], wxyz[1], wxyz[2], wxyz[3]).normalized().toRotationMatrix();
}

inline Vec3d vector_of(const float* v) { return {v[0], v[1], v[2]}; }

inline Eye eye_of(const CameraConfig& camera, const Vec3d& position, const Eigen::Matrix3d& body) {
  return {position + body * vector_of(camera.offset_m.data()), body * matrix_of(camera.quat_wxyz.data())};
}

// Returns the focal lengths in pixels, horizontal and vertical.
inline std::array<double, 2> focal_lengths(const CameraConfig& camera) {
  const auto focal = [](int pixels, float fov_deg) {
    return 0.5 * pixels / std::tan(0.5 * static_cast<double>(fov_deg) * std::numbers::pi / 180.0);
  };
  if (camera.hfov_deg && camera.vfov_deg)
    return {focal(camera.width_px, *camera.hfov_deg), focal(camera.height_px, *camera.vfov_deg)};
  const double f =
      camera.vfov_deg ? focal(camera.height_px, *camera.vfov_deg) : focal(camera.width_px, camera.hfov_deg.value_or(90));
  return {f, f};
}

// Returns the direction through the image point (u, v), in pixels from the upper left corner. It is in the world frame and has
// length 1 along the optical axis.
inline Vec3d direction_through(const CameraConfig& camera, const Eye& eye, double u, double v) {
  const auto [fx, fy] = focal_lengths(camera);
  return eye.rotation * Vec3d(1.0, (0.5 * camera.width_px - u) / fx, (0.5 * camera.height_px - v) / fy);
}

// -- Transparent texels.

inline double wrapped(double x, TextureWrap wrap) {
  if (wrap == TextureWrap::clamp) return std::clamp(x, 0.0, 1.0);
  if (wrap == TextureWrap::repeat) return x - std::floor(x);
  const double there_and_back = std::fmod(std::abs(x), 2.0);
  return there_and_back > 1.0 ? 2.0 - there_and_back : there_and_back;
}

// Returns the index of a texel. The argument may be one beyond the border.
inline int texel_index(int index, int size, TextureWrap wrap) {
  return wrap == TextureWrap::repeat ? (index + size) % size : std::clamp(index, 0, size - 1);
}

// Returns the barycentric weights of a triangle's second and third corners at a point.
inline Eigen::Vector2d weights_at(const TriangleMesh& mesh, std::size_t triangle, const Vec3d& point) {
  const auto corner = [&](std::size_t k) -> Vec3d {
    return mesh.vertices[static_cast<std::size_t>(mesh.triangles[triangle][k])].cast<double>();
  };
  const Vec3d a = corner(1) - corner(0), b = corner(2) - corner(0), way = point - corner(0);
  const Vec3d normal = a.cross(b);
  return Eigen::Vector2d(way.cross(b).dot(normal), a.cross(way).dot(normal)) / normal.squaredNorm();
}

inline Eigen::Vector2d place_in_texture(const TriangleMesh& mesh, std::size_t triangle, const Vec3d& point) {
  std::array<Eigen::Vector2d, 3> uv;
  for (std::size_t k = 0; k < 3; ++k) {
    const auto vertex = static_cast<std::size_t>(mesh.triangles[triangle][k]);
    uv[k] = {static_cast<double>(mesh.uv[vertex][0]), static_cast<double>(mesh.uv[vertex][1])};
  }
  const Eigen::Vector2d weights = weights_at(mesh, triangle, point);
  return uv[0] + weights[0] * (uv[1] - uv[0]) + weights[1] * (uv[2] - uv[0]);
}

// Returns the alpha of an image at (s, t), in [0, 1].
inline double alpha_at(const Texture& image, double s, double t) {
  const double x = wrapped(s, image.wrap[0]) * image.width_px - 0.5;
  const double y = wrapped(t, image.wrap[1]) * image.height_px - 0.5;
  double alpha = 0.0;
  for (int j = 0; j < 2; ++j) {
    for (int i = 0; i < 2; ++i) {
      const double across = x - std::floor(x);
      const double down = y - std::floor(y);
      const int column = texel_index(static_cast<int>(std::floor(x)) + i, image.width_px, image.wrap[0]);
      const int row = texel_index(static_cast<int>(std::floor(y)) + j, image.height_px, image.wrap[1]);
      const auto byte = image.rgba[static_cast<std::size_t>(4 * (row * image.width_px + column) + 3)];
      alpha += (i == 0 ? 1.0 - across : across) * (j == 0 ? 1.0 - down : down) * byte / 255.0;
    }
  }
  return alpha;
}

// Returns whether a triangle is opaque for cameras and sunlight at a point.
inline bool is_seen(const World& world, std::size_t triangle, const Vec3d& point) {
  const TriangleMesh& mesh = world.triangles();
  const Material& material = world.materials()[mesh.materials[triangle]];
  if (material.alpha_cutoff == 0.0F || !material.texture) return true;
  const Eigen::Vector2d place = place_in_texture(mesh, triangle, point);
  return alpha_at(world.textures()[*material.texture], place.x(), place.y()) >= static_cast<double>(material.alpha_cutoff);
}

// -- Hits.

// Elements are numbered as in World::raycast. The markers follow the triangles: start, waypoints, goal.
struct Seen {
  double depth = kNever;  // m, planar
  int element = -1;
  Vec3d normal = Vec3d::Zero();  // facing the camera
};

inline std::vector<Vec3d> places_of(const Markers& markers) {
  std::vector<Vec3d> places;
  if (markers.start) places.emplace_back(markers.start->cast<double>());
  for (const Vec3& waypoint : markers.waypoints) places.emplace_back(waypoint.cast<double>());
  if (markers.goal) places.emplace_back(markers.goal->cast<double>());
  return places;
}

inline int first_marker(const World& world) {
  return static_cast<int>(world.primitives().size() + world.triangles().triangles.size());
}

// Returns the nearest hit of a ray that starts at the near plane. A marker counts if its entry point is beyond the near plane.
inline Seen see(const World& world, const CameraConfig& camera, const Vec3d& origin, const Vec3d& direction) {
  const double near = camera.near_m;
  const double far = camera.far_m;
  const double length = direction.norm();
  Seen seen;
  const Hit hit = nearest(world, origin + near * direction, direction / length, (far - near) * length,
                          [&](std::size_t triangle, const Vec3d& point) { return is_seen(world, triangle, point); });
  if (hit.element >= 0) seen = {near + hit.t / length, hit.element, hit.normal};
  int element = first_marker(world);
  for (const Vec3d& place : places_of(world.markers())) {
    const Interval inside = ball(origin - place, direction, static_cast<double>(world.markers().radius));
    if (inside.enter >= near && inside.enter <= far && inside.enter < seen.depth) {
      seen = {inside.enter, element, (origin + inside.enter * direction - place).normalized()};
    }
    ++element;
  }
  return seen;
}

// Returns whether slightly offset rays give nearly the same result: no edge, silhouette, near plane or far plane is close, and
// the hit is not at a grazing angle.
inline bool is_clear(const World& world, const CameraConfig& camera, const Seen& seen, const Vec3d& origin,
                     const Vec3d& direction) {
  constexpr double kAside = 2e-5;  // m
  constexpr double kSteep = 5.0;
  if (std::abs(seen.depth - static_cast<double>(camera.far_m)) < kAside) return false;
  const Vec3d along = direction.normalized();
  const Vec3d u = along.unitOrthogonal();
  const Vec3d v = along.cross(u);
  for (const Vec3d& aside : {u, Vec3d(-u), v, Vec3d(-v), along, Vec3d(-along)}) {
    const Seen other = see(world, camera, origin + kAside * aside, direction);
    if (other.element != seen.element) return false;
    if (seen.element < 0) continue;
    if (other.normal.dot(seen.normal) < 0.999) return false;
    if (std::abs(other.depth - seen.depth) * direction.norm() > kSteep * kAside) return false;
  }
  return true;
}

// -- Shading.

inline Vec3d to_sun(const World& world) { return vector_of(world.light().sun_direction.data()).normalized(); }

// Returns whether a ray from a point outside a room passes through it. Sunlight runs the other way and hits the room from
// inside.
inline bool is_behind(const Primitive& room, const Vec3d& point, const Vec3d& direction) {
  Interval inside;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    const double from = point[axis] - static_cast<double>(room.center[axis]);
    inside = both(inside, slab(from, direction[axis], static_cast<double>(room.half_extents[axis])));
  }
  return inside.enter > 0.0 && inside.enter <= inside.exit;
}

inline bool is_shaded(const World& world, const Vec3d& point) {
  const auto primitives = world.primitives();
  const Vec3d sun = to_sun(world);
  for (const Primitive& primitive : primitives) {
    if (primitive.kind == PrimitiveKind::room ? is_behind(primitive, point, sun)
                                              : hit_primitive(primitive, point, sun).t < kNever)
      return true;
  }
  for (std::size_t i = 0; i < world.triangles().triangles.size(); ++i) {
    const Hit hit = hit_triangle(world.triangles(), i, point, sun);
    if (hit.t < kNever && is_seen(world, i, point + hit.t * sun)) return true;
  }
  return false;
}

enum class Shade : std::uint8_t { lit, shaded, unclear };

// The result is unclear if a shadow's edge is within 1 cm.
inline Shade shade_at(const World& world, const Vec3d& point, const Vec3d& normal) {
  constexpr double kBeside = 1e-2;  // m
  const Vec3d sun = to_sun(world);
  if (normal.dot(sun) <= 0.0) return Shade::lit;  // turned away from the sun, so shadows do not matter
  const Vec3d off = point + 1e-3 * normal;
  const Vec3d u = normal.unitOrthogonal();
  const Vec3d v = normal.cross(u);
  const bool shaded = is_shaded(world, off);
  for (const Vec3d& aside : {u, Vec3d(-u), v, Vec3d(-v), normal}) {
    if (is_shaded(world, off + kBeside * aside) != shaded) return Shade::unclear;
  }
  return shaded ? Shade::shaded : Shade::lit;
}

struct Surface {
  Vec3d color;
  int semantic, instance;
  Vec3d emissive = Vec3d::Zero();
};

inline Surface surface_of(const World& world, int element) {
  const auto primitives = static_cast<int>(world.primitives().size());
  const TriangleMesh& mesh = world.triangles();
  const int objects = mesh.objects.empty() ? 0 : 1 + *std::max_element(mesh.objects.begin(), mesh.objects.end());
  const auto of_material = [&](std::size_t material, int instance) {
    const Material& paint = world.materials()[material];
    const int semantic = paint.semantic != 0 ? paint.semantic : static_cast<int>(material) + 1;
    return Surface{vector_of(paint.base_color.data()), semantic, instance, vector_of(paint.emissive.data())};
  };
  if (element < primitives) return of_material(world.primitives()[static_cast<std::size_t>(element)].material, element + 1);
  if (element < first_marker(world)) {
    const auto triangle = static_cast<std::size_t>(element - primitives);
    return of_material(mesh.materials[triangle], primitives + 1 + mesh.objects[triangle]);
  }
  const int marker = element - first_marker(world);
  const int instance = primitives + objects + 1 + marker;
  const auto last = static_cast<int>(places_of(world.markers()).size()) - 1;
  if (world.markers().start && marker == 0) return {{0.8, 0.03, 0.02}, kSemanticStart, instance};
  if (world.markers().goal && marker == last) return {{0.02, 0.6, 0.05}, kSemanticGoal, instance};
  return {{0.85, 0.6, 0.02}, kSemanticWaypoint, instance};
}

// -- Textures, by the rules above struct Textures.

struct TexelGrid {
  int width, height;
  std::vector<Vec3d> linear;  // row by row
  std::vector<double> alpha;  // row by row, bytes; empty if alpha does not matter

  const Vec3d& at(int row, int column) const {
    return linear[static_cast<std::size_t>(row) * static_cast<std::size_t>(width) + static_cast<std::size_t>(column)];
  }
};

inline double linear_of(double byte) {
  const double value = byte / 255.0;
  return value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
}

inline double rounded_to_byte(double linear) {
  return std::round(255.0 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1.0 / 2.4) - 0.055));
}

// Returns the mean colour and alpha over a rectangle in texels. Colours are weighted by alpha if alpha matters and is not 0
// everywhere.
inline std::pair<Vec3d, double> mean_over(const TexelGrid& grid, double left, double right, double top, double bottom) {
  Vec3d sum = Vec3d::Zero(), seen = Vec3d::Zero();
  double alpha = 0.0;
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      const double across = std::min(right, column + 1.0) - std::max(left, 1.0 * column);
      const double down = std::min(bottom, row + 1.0) - std::max(top, 1.0 * row);
      if (!(across > 0.0 && down > 0.0)) continue;
      sum += across * down * grid.at(row, column);
      if (grid.alpha.empty()) continue;
      const double weight = across * down * grid.alpha[static_cast<std::size_t>(row * grid.width + column)];
      seen += weight * grid.at(row, column);
      alpha += weight;
    }
  }
  const double area = (right - left) * (bottom - top);
  return {alpha > 0.0 ? Vec3d(seen / alpha) : Vec3d(sum / area), alpha / area};
}

// Returns the mip levels of an image, each rounded to sRGB bytes. masked: the image has transparent texels.
inline std::vector<TexelGrid> mip_levels(const Texture& image, bool masked = false) {
  std::vector<TexelGrid> levels{{image.width_px, image.height_px, {}, {}}};
  for (std::size_t i = 0; i < image.rgba.size(); i += 4) {
    levels[0].linear.emplace_back(linear_of(image.rgba[i]), linear_of(image.rgba[i + 1]), linear_of(image.rgba[i + 2]));
    if (masked) levels[0].alpha.push_back(image.rgba[i + 3]);
  }
  while (levels.back().width > 1 || levels.back().height > 1) {
    const TexelGrid before = levels.back();
    TexelGrid next{std::max(before.width / 2, 1), std::max(before.height / 2, 1), {}, {}};
    const double x = static_cast<double>(before.width) / next.width;
    const double y = static_cast<double>(before.height) / next.height;
    for (int row = 0; row < next.height; ++row) {
      for (int column = 0; column < next.width; ++column) {
        auto [mean, alpha] = mean_over(before, column * x, (column + 1) * x, row * y, (row + 1) * y);
        for (double& value : mean) value = linear_of(rounded_to_byte(value));
        next.linear.push_back(mean);
        if (masked) next.alpha.push_back(std::round(alpha));
      }
    }
    levels.push_back(next);
  }
  return levels;
}

inline Vec3d between_texels(const TexelGrid& grid, double s, double t, const std::array<TextureWrap, 2>& wrap) {
  const double x = wrapped(s, wrap[0]) * grid.width - 0.5;
  const double y = wrapped(t, wrap[1]) * grid.height - 0.5;
  Vec3d color = Vec3d::Zero();
  for (int j = 0; j < 2; ++j) {
    for (int i = 0; i < 2; ++i) {
      const double across = x - std::floor(x);
      const double down = y - std::floor(y);
      const int column = texel_index(static_cast<int>(std::floor(x)) + i, grid.width, wrap[0]);
      const int row = texel_index(static_cast<int>(std::floor(y)) + j, grid.height, wrap[1]);
      color += (i == 0 ? 1.0 - across : across) * (j == 0 ? 1.0 - down : down) * grid.at(row, column);
    }
  }
  return color;
}

// Returns the texture colour of a triangle at a point, or white if it has no texture. pixel: width of a pixel at planar depth
// 1.
inline Vec3d texture_color(const World& world, const std::vector<std::vector<TexelGrid>>& images, std::size_t triangle,
                           const Vec3d& point, const Vec3d& normal, const Vec3d& direction, double depth, double pixel) {
  const TriangleMesh& mesh = world.triangles();
  const auto& texture = world.materials()[mesh.materials[triangle]].texture;
  if (!texture) return Vec3d::Ones();
  const Texture& image = world.textures()[*texture];
  std::array<Vec3d, 3> at;
  std::array<Eigen::Vector2d, 3> uv;
  for (std::size_t k = 0; k < 3; ++k) {
    const auto vertex = static_cast<std::size_t>(mesh.triangles[triangle][k]);
    at[k] = mesh.vertices[vertex].cast<double>();
    uv[k] = {static_cast<double>(mesh.uv[vertex][0]), static_cast<double>(mesh.uv[vertex][1])};
  }
  const Eigen::Vector2d place = place_in_texture(mesh, triangle, point);
  Eigen::Matrix2d shown;
  shown << uv[1] - uv[0], uv[2] - uv[0];
  const double texels =
      std::abs(shown.determinant()) * image.width_px * image.height_px / (at[1] - at[0]).cross(at[2] - at[0]).norm();
  const double covered = texels * std::pow(pixel * depth * direction.norm() / std::abs(normal.dot(direction)), 2);
  int exponent = 0;
  const double mantissa = 2.0 * std::frexp(covered, &exponent);
  const std::vector<TexelGrid>& levels = images[*texture];
  const double last = static_cast<double>(levels.size()) - 1.0;
  const double detail = covered > 0.0 ? std::clamp(0.5 * (exponent - 1 + mantissa - 1.0), 0.0, last) : 0.0;
  const auto color = [&](double level) {
    return between_texels(levels[static_cast<std::size_t>(level)], place.x(), place.y(), image.wrap);
  };
  const double fine = std::floor(detail);
  return color(fine) + (detail - fine) * (color(std::min(fine + 1.0, last)) - color(fine));
}

// Returns the interpolated vertex colour of a triangle at a point, or white if it has none.
inline Vec3d vertex_color(const TriangleMesh& mesh, std::size_t triangle, const Vec3d& point) {
  if (mesh.colors.empty()) return Vec3d::Ones();
  const auto color = [&](std::size_t k) {
    return vector_of(mesh.colors[static_cast<std::size_t>(mesh.triangles[triangle][k])].data());
  };
  const Eigen::Vector2d weights = weights_at(mesh, triangle, point);
  return color(0) + weights[0] * (color(1) - color(0)) + weights[1] * (color(2) - color(0));
}

// -- Output values.

inline int level(const World& world, double value) {
  return static_cast<int>(std::lround(255.0 * std::pow(std::min(value, 1.0), 1.0 / static_cast<double>(world.light().gamma))));
}

inline std::array<int, 3> levels(const World& world, const Vec3d& values) {
  return {level(world, values.x()), level(world, values.y()), level(world, values.z())};
}

inline Vec3d lerp(const std::array<float, 3>& a, const std::array<float, 3>& b, double part) {
  return vector_of(a.data()) + part * (vector_of(b.data()) - vector_of(a.data()));
}

// Returns the colour of the sky without the sun.
inline Vec3d clear_sky(const World& world, const Vec3d& direction) {
  const Light& light = world.light();
  return lerp(light.horizon_color, light.zenith_color, std::max(0.0, direction.normalized().z()));
}

// ray: from the eye to the surface, m.
inline std::array<int, 3> surface_levels(const World& world, const Surface& surface, const Vec3d& normal, bool shaded,
                                         const Vec3d& ray) {
  const Light& light = world.light();
  const double sun = shaded ? 0.0 : std::max(0.0, normal.dot(to_sun(world)));
  const Vec3d light_there =
      sun * vector_of(light.sun_color.data()) + lerp(light.ground_ambient, light.sky_ambient, 0.5 * (1.0 + normal.z()));
  const Vec3d color = surface.color.cwiseProduct(light_there) + surface.emissive;
  if (light.fog_visibility_m == 0.0F) return levels(world, color);
  const double fog = -std::expm1(-3.9 * ray.norm() / static_cast<double>(light.fog_visibility_m));
  return levels(world, color + fog * (clear_sky(world, ray) - color));
}

inline std::array<int, 3> sky_levels(const World& world, const Vec3d& direction) {
  const Light& light = world.light();
  Vec3d sky = clear_sky(world, direction);
  // The sun's disc and its glow, by angle.
  const Vec3d sun = vector_of(light.sun_color.data());
  if (sun.maxCoeff() > 0.0) {
    const double angle = std::atan2(direction.cross(to_sun(world)).norm(), direction.dot(to_sun(world)));
    const double radius = static_cast<double>(light.sun_radius_deg) * std::numbers::pi / 180.0;
    const double chord = 2.0 * std::sin(0.5 * angle) / std::max(2.0 * std::sin(0.5 * radius), 1e-9);  // in radii
    const double disc = std::clamp((1.0 - chord * chord) / 0.19, 0.0, 1.0);
    const double glow = static_cast<double>(light.sun_glow) / (1.0 + 400.0 * std::pow(std::sin(0.5 * angle), 2));
    sky += std::max(disc, glow) * (sun / sun.maxCoeff() - sky);
  }
  return levels(world, sky);
}

}  // namespace flockstep::oracle

namespace flockstep::testing {

inline constexpr CameraOutputs kAllOutputs{
    .rgb = true, .depth = true, .semantic = true, .instance = true, .normal = true, .grey = true};

inline BatchConfig camera_batch(const CameraConfig& camera, int num_drones = 1) {
  BatchConfig config;
  config.num_envs = num_drones;
  config.num_threads = 1;
  config.cameras = {camera};
  return config;
}

// Returns a batch with one drone at this pose, with its image captured.
inline std::unique_ptr<Batch> look(const std::shared_ptr<const World>& world, const CameraConfig& camera, const Vec3& position,
                                   const Quat& rotation = Quat::Identity()) {
  auto batch = std::make_unique<Batch>(camera_batch(camera), Batch::Worlds{world});
  batch->set_pose(std::vector<float>{position.x(), position.y(), position.z()},
                  std::vector<float>{rotation.w(), rotation.x(), rotation.y(), rotation.z()});
  batch->sense();
  return batch;
}

// The outputs of one pixel; 0 for outputs that the camera does not write.
struct Pixel {
  std::array<int, 3> rgb{};
  float depth = 0.0F;
  int semantic = 0, instance = 0;
  Vec3 normal = Vec3::Zero();
  int grey = 0;
};

inline Pixel pixel(const Batch& batch, std::size_t row, std::size_t column, std::size_t drone = 0, std::size_t camera = 0) {
  const CameraConfig& config = batch.config().cameras[camera];
  const CameraImages& images = batch.camera(camera).images();
  const auto width = static_cast<std::size_t>(config.width_px);
  const auto plane = width * static_cast<std::size_t>(config.height_px);
  const std::size_t place = row * width + column;
  const auto channel = [&](std::size_t c) {
    return 3 * drone * plane + (config.layout == ImageLayout::hwc ? 3 * place + c : c * plane + place);
  };
  Pixel pixel;
  for (std::size_t c = 0; c < 3; ++c) {
    if (config.outputs.rgb) pixel.rgb[c] = images.rgb[channel(c)];
    if (config.outputs.normal) pixel.normal[static_cast<Eigen::Index>(c)] = images.normal[channel(c)];
  }
  if (config.outputs.depth) pixel.depth = images.depth[drone * plane + place];
  if (config.outputs.semantic) pixel.semantic = images.semantic[drone * plane + place];
  if (config.outputs.instance) pixel.instance = images.instance[drone * plane + place];
  if (config.outputs.grey) pixel.grey = images.grey[drone * plane + place];
  return pixel;
}

struct Compared {
  std::size_t pixels = 0, clear = 0, sky = 0, shaded = 0, lit = 0;
  std::set<int> elements;  // visible elements

  Compared& operator+=(const Compared& other) {
    pixels += other.pixels;
    clear += other.clear;
    sky += other.sky;
    shaded += other.shaded;
    lit += other.lit;
    elements.insert(other.elements.begin(), other.elements.end());
    return *this;
  }
};

// Returns whether two colours differ by at most one level.
inline bool is_near(const std::array<int, 3>& a, const std::array<int, 3>& b) {
  for (std::size_t c = 0; c < 3; ++c) {
    if (std::abs(a[c] - b[c]) > 1) return false;
  }
  return true;
}

// Checks all outputs of a drone's camera against the oracle. The drone must not have moved since the capture. Compares the
// clear ones among every stride-th pixel. With several samples per pixel, colours are not compared.
inline Compared expect_picture(const Batch& batch, std::size_t drone = 0, std::size_t camera = 0, std::size_t stride = 1) {
  using oracle::Vec3d;
  const CameraConfig config = batch.camera(camera).config(DroneIndex(drone));
  const State& state = batch.state();
  const World& world = *batch.worlds()[static_cast<std::size_t>(state.world_index[drone])];
  const oracle::Eye eye =
      oracle::eye_of(config, oracle::vector_of(&state.position[3 * drone]), oracle::matrix_of(&state.quat_wxyz[4 * drone]));
  const CameraOutputs& outputs = config.outputs;
  const auto width = static_cast<std::size_t>(config.width_px);
  const auto height = static_cast<std::size_t>(config.height_px);
  std::vector<std::vector<oracle::TexelGrid>> images;
  for (std::size_t i = 0; i < world.textures().size(); ++i) {
    const Texture& image = world.textures()[i];
    bool masked = false;
    for (const Material& material : world.materials()) {
      if (material.texture != i) continue;
      for (std::size_t k = 3; k < image.rgba.size(); k += 4) masked |= image.rgba[k] < 255.0F * material.alpha_cutoff;
    }
    images.push_back(oracle::mip_levels(image, masked));
  }
  Compared compared;
  std::size_t wrong = 0;
  for (std::size_t place = 0; place < width * height; place += stride) {
    const std::size_t row = place / width;
    const std::size_t column = place % width;
    ++compared.pixels;
    const Vec3d direction =
        oracle::direction_through(config, eye, static_cast<double>(column) + 0.5, static_cast<double>(row) + 0.5);
    const oracle::Seen seen = oracle::see(world, config, eye.origin, direction);
    if (!oracle::is_clear(world, config, seen, eye.origin, direction)) continue;
    const Pixel is = pixel(batch, row, column, drone, camera);
    oracle::Surface surface{Vec3d::Zero(), 0, 0};
    bool colors_are_clear = config.samples_per_pixel == 1;
    std::array<int, 3> rgb{};
    if (seen.element < 0) {
      rgb = oracle::sky_levels(world, direction);
    } else {
      surface = oracle::surface_of(world, seen.element);
      const Vec3d point = eye.origin + seen.depth * direction;
      const auto primitives = static_cast<int>(world.primitives().size());
      if (seen.element >= primitives && seen.element < oracle::first_marker(world)) {
        const auto triangle = static_cast<std::size_t>(seen.element - primitives);
        const double width_of_pixel = 1.0 / oracle::focal_lengths(config)[0];
        const Vec3d tint =
            oracle::texture_color(world, images, triangle, point, seen.normal, direction, seen.depth, width_of_pixel)
                .cwiseProduct(oracle::vertex_color(world.triangles(), triangle, point));
        surface.color = surface.color.cwiseProduct(tint);
        surface.emissive = surface.emissive.cwiseProduct(tint);
      }
      auto shade = oracle::Shade::lit;
      if (config.shadows) shade = oracle::shade_at(world, eye.origin + seen.depth * direction, seen.normal);
      colors_are_clear &= shade != oracle::Shade::unclear;
      rgb = oracle::surface_levels(world, surface, seen.normal, shade == oracle::Shade::shaded, seen.depth * direction);
      compared.shaded += shade == oracle::Shade::shaded;
      compared.lit += shade == oracle::Shade::lit;
    }
    const double depth = seen.depth * (config.depth_kind == DepthKind::range ? direction.norm() : 1.0);
    const auto is_depth = [&](float value) {
      if (seen.element < 0) return value == std::numeric_limits<float>::infinity();
      return std::abs(static_cast<double>(value) - depth) <= 2e-5 * std::max(1.0, depth);
    };
    const bool right = (!outputs.depth || is_depth(is.depth)) && (!outputs.semantic || is.semantic == surface.semantic) &&
                       (!outputs.instance || is.instance == surface.instance) &&
                       (!outputs.normal || (is.normal.cast<double>() - seen.normal).norm() <= 2e-3) &&
                       (!outputs.rgb || !colors_are_clear || is_near(is.rgb, rgb));
    ++compared.clear;
    compared.sky += seen.element < 0;
    compared.elements.insert(seen.element);
    if (right || wrong++ > 0) continue;
    ADD_FAILURE() << "drone " << drone << ", row " << row << ", column " << column << ": expected element " << seen.element
                  << " (semantic " << surface.semantic << ", instance " << surface.instance << ") at " << depth << " m, normal "
                  << seen.normal.transpose() << ", rgb " << rgb[0] << ' ' << rgb[1] << ' ' << rgb[2] << "; got semantic "
                  << is.semantic << ", instance " << is.instance << ", " << is.depth << " m, normal " << is.normal.transpose()
                  << ", rgb " << is.rgb[0] << ' ' << is.rgb[1] << ' ' << is.rgb[2];
  }
  EXPECT_EQ(wrong, 0U) << "of " << compared.clear << " clear pixels";
  return compared;
}

}  // namespace flockstep::testing
