#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "allocation_counter.hpp"
#include "batch_helpers.hpp"
#include "faulty_driver.hpp"
#include "picture_oracle.hpp"
#include "prepared/prepared_world.hpp"
#include "random.hpp"
#include "ray_oracle.hpp"
#include "render/appearance.hpp"
#include "render/gl/renderer.hpp"
#include "standard.hpp"

#if !defined(_WIN32)
#include <sys/wait.h>
#include <unistd.h>
#endif

namespace flockstep::render {
namespace {

using testing::kInfinity;

using flockstep::testing::FaultyDriver;
using flockstep::testing::make_world;
using flockstep::testing::message_of;
using flockstep::testing::playground;
using flockstep::testing::primitive;
using flockstep::testing::Random;
using oracle::Vec3d;
using enum PrimitiveKind;

// Sets FLOCKSTEP_EGL during its lifetime.
class EglVariable {
 public:
  explicit EglVariable(const char* value) { setenv("FLOCKSTEP_EGL", value, 1); }
  ~EglVariable() { unsetenv("FLOCKSTEP_EGL"); }
};

// Returns a renderer, or null and the reason.
std::unique_ptr<GlRenderer> try_renderer(std::string& why) {
  try {
    return std::make_unique<GlRenderer>();
  } catch (const GlUnavailable& error) {
    why = error.what();
    return nullptr;
  }
}

// Skips the test if OpenGL is not installed. If Mesa or a driver is installed, the renderer must work.
#define NEEDS_RENDERER(name)                                                     \
  std::string no_renderer;                                                       \
  const std::unique_ptr<GlRenderer> name##_owner = try_renderer(no_renderer);    \
  if (!name##_owner && no_renderer.find("not installed") != std::string::npos) { \
    GTEST_SKIP() << no_renderer;                                                 \
  }                                                                              \
  ASSERT_TRUE(name##_owner) << no_renderer;                                      \
  [[maybe_unused]] GlRenderer& name = *name##_owner

CameraConfig camera_of(int width, int height, float hfov_deg = 90.0F) {
  CameraConfig camera;
  camera.width_px = width;
  camera.height_px = height;
  camera.hfov_deg = hfov_deg;
  camera.outputs = {.rgb = true, .depth = true, .semantic = true, .instance = true, .normal = true, .grey = true};
  return camera;
}

PinholeCamera pinhole_of(const CameraConfig& camera) {
  const float half = 0.5F * *camera.hfov_deg * std::numbers::pi_v<float> / 180.0F;
  PinholeCamera pinhole{};
  pinhole.fx = pinhole.fy = 0.5F * static_cast<float>(camera.width_px) / std::tan(half);
  pinhole.cx = 0.5F * static_cast<float>(camera.width_px);
  pinhole.cy = 0.5F * static_cast<float>(camera.height_px);
  return pinhole;
}

struct Pose {
  Vec3 position = Vec3::Zero();
  Mat3 rotation = Mat3::Identity();
};

Pose looking(const Vec3& from, const Vec3& to) {
  const Vec3 forward = (to - from).normalized();
  const Vec3 left = Vec3::UnitZ().cross(forward).normalized();
  Pose pose{from, {}};
  pose.rotation << forward, left, forward.cross(left);
  return pose;
}

// Requests and their rendered images.
struct Album {
  CameraConfig camera;
  PinholeCamera pinhole;
  std::vector<RenderRequest> requests;
  CameraImages images;
  Workers workers{2};

  explicit Album(const CameraConfig& config) : camera(config), pinhole(pinhole_of(config)) {}
  Album(const Album&) = delete;
  Album& operator=(const Album&) = delete;

  void add(const World& world, const Pose& pose = {}) {
    requests.push_back(
        {&world, &prepared(world).scene(), &prepared(world).shading(), &camera, &pinhole, pose.position, pose.rotation, {}});
  }
  std::size_t pixels() const { return static_cast<std::size_t>(camera.width_px) * static_cast<std::size_t>(camera.height_px); }

  // Allocates the images, fills them with values that no image has, and sets the targets of the requests.
  void prepare() {
    const auto room = [&](auto& images, bool wanted, std::size_t channels, auto value) {
      images.assign(wanted ? requests.size() * pixels() * channels : 0, value);
    };
    const CameraOutputs& outputs = camera.outputs;
    room(images.rgb, outputs.rgb, 3, std::uint8_t{77});
    room(images.depth, outputs.depth, 1, -1.0F);
    room(images.semantic, outputs.semantic, 1, std::uint16_t{777});
    room(images.instance, outputs.instance, 1, std::uint16_t{777});
    room(images.normal, outputs.normal, 3, -7.0F);
    room(images.grey, outputs.grey, 1, std::uint8_t{77});
    for (std::size_t i = 0; i < requests.size(); ++i) {
      const auto at = [&](auto& images, std::size_t channels) {
        return images.empty() ? nullptr : images.data() + i * pixels() * channels;
      };
      requests[i].frame = {at(images.rgb, 3),      at(images.depth, 1),  at(images.semantic, 1),
                           at(images.instance, 1), at(images.normal, 3), at(images.grey, 1)};
    }
  }

  void take(GlRenderer& renderer) {
    prepare();
    renderer.start(requests);
    renderer.finish(workers);
  }

  std::size_t at(std::size_t request, int u, int v) const {
    return request * pixels() + static_cast<std::size_t>(v) * static_cast<std::size_t>(camera.width_px) +
           static_cast<std::size_t>(u);
  }
  std::array<std::uint8_t, 3> rgb(std::size_t request, int u, int v) const {
    const std::uint8_t* at_pixel = images.rgb.data() + 3 * at(request, u, v);
    return {at_pixel[0], at_pixel[1], at_pixel[2]};
  }
  Vec3 normal(std::size_t request, int u, int v) const {
    const float* at_pixel = images.normal.data() + 3 * at(request, u, v);
    return {at_pixel[0], at_pixel[1], at_pixel[2]};
  }
  // Returns the ray through pixel (u, v), in the world frame, with a planar depth of 1 m. (du, dv) is the offset from the
  // pixel's centre.
  Vec3d ray(std::size_t request, int u, int v, double du = 0.0, double dv = 0.0) const {
    const Vec3d direction(1.0, (static_cast<double>(pinhole.cx) - u - 0.5 - du) / static_cast<double>(pinhole.fx),
                          (static_cast<double>(pinhole.cy) - v - 0.5 - dv) / static_cast<double>(pinhole.fy));
    return requests[request].rotation.cast<double>() * direction;
  }
};

// A world whose primitives cycle through three materials with the same light.
std::shared_ptr<const World> colorful(std::vector<Primitive> primitives, Markers markers = {}, TriangleMesh mesh = {}) {
  SceneDescription description;
  description.materials = {{"red", {0.8F, 0.2F, 0.1F}, 0}, {"green", {0.2F, 0.7F, 0.3F}, 40}, {"blue", {0.1F, 0.3F, 0.9F}, 7}};
  for (std::size_t i = 0; i < primitives.size(); ++i) primitives[i].material = static_cast<std::uint16_t>(i % 3);
  description.primitives = std::move(primitives);
  description.markers = std::move(markers);
  description.mesh = std::move(mesh);
  if (!description.mesh.triangles.empty() && description.mesh.objects.empty()) {
    for (std::size_t i = 0; i < description.mesh.triangles.size(); ++i) {
      description.mesh.materials.push_back(static_cast<std::uint16_t>(i % 3));
      description.mesh.objects.push_back(static_cast<std::uint16_t>(i % 5));
    }
  }
  return std::make_shared<const World>(std::move(description));
}

// The expected values of a pixel, computed in double precision from closed forms.
struct Seen {
  double depth = oracle::kNever;  // planar
  int element = -1;               // numbered as in World::raycast, then the markers
  Vec3d normal = Vec3d::Zero();
  Surface surface;
};

Seen look(const World& world, const Appearance& appearance, const CameraConfig& camera, const Vec3d& eye, const Vec3d& ray) {
  // Start at the near plane: anything nearer is behind the origin.
  const auto near = static_cast<double>(camera.near_m);
  const double reach = static_cast<double>(camera.far_m) - near;
  const Vec3d origin = eye + near * ray;
  const std::size_t num_primitives = world.primitives().size();
  oracle::Hit hit = oracle::nearest(world, origin, ray, reach);
  Seen seen;
  if (hit.element >= 0) {
    seen = {near + hit.t, hit.element, hit.normal, {}};
    const auto element = static_cast<std::size_t>(hit.element);
    if (element < num_primitives) {
      seen.surface = appearance.primitives[element];
    } else {
      const std::size_t triangle = element - num_primitives;
      seen.surface = appearance.materials[world.triangles().materials[triangle]];
      seen.surface.instance = static_cast<std::uint16_t>(appearance.first_object + world.triangles().objects[triangle]);
    }
  }
  for (std::size_t i = 0; i < appearance.markers.size(); ++i) {
    const MarkerSphere& marker = appearance.markers[i];
    const Vec3d center = marker.center.cast<double>();
    const double t = oracle::ball(origin - center, ray, static_cast<double>(appearance.marker_radius)).enter;
    if (t < 0.0 || t > reach || near + t >= seen.depth) continue;
    seen = {near + t, static_cast<int>(num_primitives + world.triangles().triangles.size() + i),
            (origin + t * ray - center).normalized(), marker.surface};
  }
  return seen;
}

bool sun_reaches(const World& world, const Vec3d& point, const Light& light) {
  const Vec3d sun(light.sun_direction[0], light.sun_direction[1], light.sun_direction[2]);
  for (const Primitive& shape : world.primitives()) {
    if (shape.kind == room ? oracle::is_behind(shape, point, sun) : oracle::hit_primitive(shape, point, sun).t < oracle::kNever)
      return false;
  }
  for (std::size_t i = 0; i < world.triangles().triangles.size(); ++i) {
    if (oracle::hit_triangle(world.triangles(), i, point, sun).t < oracle::kNever) return false;
  }
  return true;
}

std::array<double, 3> color_of(const Seen& seen, const Light& light, const Vec3d& ray, bool sun) {
  std::array<double, 3> color{};
  const Vec3d direction(light.sun_direction[0], light.sun_direction[1], light.sun_direction[2]);
  for (std::size_t i = 0; i < 3; ++i) {
    const auto of = [i](const std::array<float, 3>& values) { return static_cast<double>(values[i]); };
    double value = 0.0;
    if (seen.element < 0) {
      const double up = std::max(0.0, ray.normalized().z());
      value = of(light.horizon_color) + up * (of(light.zenith_color) - of(light.horizon_color));
    } else {
      const double above = 0.5 * (1.0 + seen.normal.z());
      value = of(seen.surface.color) * ((sun ? of(light.sun_color) * std::max(0.0, seen.normal.dot(direction)) : 0.0) +
                                        of(light.ground_ambient) + above * (of(light.sky_ambient) - of(light.ground_ambient)));
    }
    color[i] = 255.0 * std::pow(std::min(value, 1.0), 1.0 / static_cast<double>(light.gamma));
  }
  return color;
}

// Checks every pixel whose neighbourhood, a twentieth of a pixel wide, shows a single face of a single object. The others are
// edges and silhouettes.
void expect_true(const Album& album, double least_share) {
  std::size_t clear = 0;
  std::size_t total = 0;
  std::size_t bad = 0;
  for (std::size_t i = 0; i < album.requests.size(); ++i) {
    const RenderRequest& request = album.requests[i];
    const Appearance appearance(*request.world);
    const Light& light = request.world->light();
    const Vec3d eye = request.position.cast<double>();
    for (int v = 0; v < album.camera.height_px; ++v) {
      for (int u = 0; u < album.camera.width_px; ++u) {
        ++total;
        const Vec3d ray = album.ray(i, u, v);
        const Seen seen = look(*request.world, appearance, album.camera, eye, ray);
        const auto lit = [&](const Seen& what, const Vec3d& along) {
          return !album.camera.shadows || what.element < 0 ||
                 sun_reaches(*request.world, eye + what.depth * along + 1e-3 * what.normal, light);
        };
        const bool sun = lit(seen, ray);
        bool is_clear = true;
        for (const auto& [du, dv] : {std::pair{0.05, 0.0}, {-0.05, 0.0}, {0.0, 0.05}, {0.0, -0.05}}) {
          const Vec3d aside = album.ray(i, u, v, du, dv);
          const Seen other = look(*request.world, appearance, album.camera, eye, aside);
          is_clear =
              is_clear && other.element == seen.element && lit(other, aside) == sun &&
              (seen.element < 0 || (other.normal.dot(seen.normal) > 0.99 && std::abs(other.depth / seen.depth - 1.0) < 0.05));
        }
        if (!is_clear) continue;
        ++clear;
        const std::size_t at = album.at(i, u, v);
        const auto depth = static_cast<double>(album.images.depth[at]);
        const double expected = album.camera.depth_kind == DepthKind::planar ? seen.depth : seen.depth * ray.norm();
        const auto color = album.rgb(i, u, v);
        const auto expected_color = color_of(seen, light, ray, sun);
        bool good = seen.element < 0 ? std::isinf(depth) : std::abs(depth - expected) <= 2e-5 * expected;
        good = good && album.images.instance[at] == seen.surface.instance && album.images.semantic[at] == seen.surface.semantic;
        good = good && (album.normal(i, u, v).cast<double>() - seen.normal).norm() < 1e-3;
        for (std::size_t k = 0; k < 3; ++k) good = good && std::abs(color[k] - expected_color[k]) < 1.0;
        if (good) continue;
        if (++bad > 5) continue;
        ADD_FAILURE() << "request " << i << " at (" << u << ", " << v << "): depth " << depth << " for " << expected
                      << ", instance " << album.images.instance[at] << " for " << seen.surface.instance << ", semantic "
                      << album.images.semantic[at] << " for " << seen.surface.semantic << ", normal "
                      << album.normal(i, u, v).transpose() << " for " << seen.normal.transpose() << ", colour " << int{color[0]}
                      << ' ' << int{color[1]} << ' ' << int{color[2]} << " for " << expected_color[0] << ' ' << expected_color[1]
                      << ' ' << expected_color[2];
      }
    }
  }
  EXPECT_EQ(bad, 0U) << "of " << clear;
  EXPECT_GE(static_cast<double>(clear), least_share * static_cast<double>(total));
}

TEST(GlRenderer, ReportsItsDevice) {
  NEEDS_RENDERER(renderer);
  EXPECT_NE(renderer.description().find("OpenGL 4."), std::string::npos) << renderer.description();
}

TEST(GlRenderer, SphereOfKnownSize) {
  NEEDS_RENDERER(renderer);
  // Seen from 5 m, a sphere of radius 3 m covers an angle of asin(3 / 5), whose tangent is 3/4: 37.5 of 50 pixels from the
  // centre.
  const auto world = make_world({primitive(sphere, {5, 0, 0}, {3, 3, 3})});
  Album album(camera_of(100, 100));
  album.add(*world);
  album.take(renderer);
  const auto is_sphere = [&](int u, int v) { return album.images.instance[album.at(0, u, v)] == 1; };
  for (const int side : {0, 1}) {
    const auto at = [&](int distance) { return side == 0 ? 49 - distance : 50 + distance; };
    EXPECT_TRUE(is_sphere(at(36), 49));
    EXPECT_FALSE(is_sphere(at(38), 49));
    EXPECT_TRUE(is_sphere(50, at(36)));
    EXPECT_FALSE(is_sphere(50, at(38)));
  }
  // The ray of the pixel next to the centre is (1, 0.01, 0.01).
  EXPECT_NEAR(album.images.depth[album.at(0, 49, 49)], 2.0F, 1e-3F);
  EXPECT_NEAR((album.normal(0, 49, 49) - Vec3(-1, 0, 0)).norm(), 0.0F, 0.02F);
  EXPECT_TRUE(std::isinf(album.images.depth[album.at(0, 0, 0)]));
  EXPECT_EQ(album.images.semantic[album.at(0, 0, 0)], 0);
  EXPECT_EQ(album.images.semantic[album.at(0, 50, 50)], 1);
  EXPECT_EQ(album.normal(0, 0, 0), Vec3::Zero());
}

TEST(GlRenderer, RowZeroIsTheTopAndColumnZeroTheLeft) {
  NEEDS_RENDERER(renderer);
  const auto world = make_world({primitive(box, {4, 0, 2}, {0.2F, 0.2F, 0.2F}), primitive(box, {4, 2, 0}, {0.2F, 0.2F, 0.2F})});
  Album album(camera_of(64, 64));
  album.add(*world);
  album.take(renderer);
  EXPECT_EQ(album.images.instance[album.at(0, 32, 16)], 1);  // up, a quarter of the image from the centre
  EXPECT_EQ(album.images.instance[album.at(0, 16, 32)], 2);  // left
  EXPECT_EQ(album.images.instance[album.at(0, 32, 48)], 0);
  EXPECT_EQ(album.images.instance[album.at(0, 48, 32)], 0);
}

TEST(GlRenderer, PlanarDepthAndRange) {
  NEEDS_RENDERER(renderer);
  const auto world = make_world({primitive(box, {5, 0, 0}, {2, 30, 30})});
  for (const DepthKind kind : {DepthKind::planar, DepthKind::range}) {
    CameraConfig camera = camera_of(30, 20);
    camera.depth_kind = kind;
    Album album(camera);
    album.add(*world);
    album.take(renderer);
    for (const auto& [u, v] : {std::pair{0, 0}, {29, 0}, {0, 19}, {15, 10}, {7, 13}}) {
      const double length = kind == DepthKind::planar ? 1.0 : album.ray(0, u, v).norm();
      EXPECT_NEAR(album.images.depth[album.at(0, u, v)], 3.0 * length, 1e-5) << u << ' ' << v;
    }
  }
}

TEST(GlRenderer, NearAndFar) {
  NEEDS_RENDERER(renderer);
  // A wall of 0.2 m at 1 m, an object at 10 m, another at 30 m.
  const auto world = make_world({primitive(box, {1.1F, 0, 0}, {0.1F, 50, 50}), primitive(sphere, {13, 0, 0}, {3, 3, 3}),
                                 primitive(cylinder, {33, 0, 0}, {3, 3, 60})});
  const auto depth_with = [&](float near_m, float far_m) {
    CameraConfig camera = camera_of(9, 9);
    camera.near_m = near_m;
    camera.far_m = far_m;
    Album album(camera);
    album.add(*world);
    album.take(renderer);
    const std::size_t middle = album.at(0, 4, 4);
    const bool seen = album.images.instance[middle] != 0;
    EXPECT_EQ(seen, std::isfinite(album.images.depth[middle]));
    if (!seen) {
      // The sky's colour at the horizon.
      EXPECT_NEAR(album.rgb(0, 4, 4)[0], 255.0 * std::pow(0.68, 1.0 / 2.2), 0.51);
      EXPECT_NEAR(album.rgb(0, 4, 4)[2], 255.0 * std::pow(0.88, 1.0 / 2.2), 0.51);
      EXPECT_EQ(album.normal(0, 4, 4), Vec3::Zero());
    }
    return album.images.depth[middle];
  };
  EXPECT_FLOAT_EQ(depth_with(0.05F, 100.0F), 1.0F);
  EXPECT_FLOAT_EQ(depth_with(0.99F, 100.0F), 1.0F);
  EXPECT_FLOAT_EQ(depth_with(1.01F, 100.0F), 1.2F);   // far side of the wall, seen from inside
  EXPECT_FLOAT_EQ(depth_with(1.3F, 100.0F), 10.0F);   // behind the wall
  EXPECT_FLOAT_EQ(depth_with(10.1F, 100.0F), 16.0F);  // far side of the sphere
  EXPECT_FLOAT_EQ(depth_with(20.0F, 100.0F), 30.0F);
  EXPECT_FLOAT_EQ(depth_with(20.0F, 30.1F), 30.0F);  // most of the cylinder is beyond the far plane
  EXPECT_EQ(depth_with(20.0F, 29.9F), kInfinity);
  EXPECT_EQ(depth_with(0.05F, 0.9F), kInfinity);
}

TEST(GlRenderer, SkyByDirection) {
  NEEDS_RENDERER(renderer);
  const auto world = make_world({primitive(sphere, {0, 0, -1000}, {1, 1, 1})});
  Album album(camera_of(40, 40));
  album.add(*world, looking({0, 0, 0}, {1, 0, 0.5F}));
  album.add(*world, looking({0, 0, 0}, {0.1F, 0.1F, 1}));
  album.take(renderer);
  for (std::size_t i = 0; i < 2; ++i) {
    for (int v = 0; v < 40; v += 3) {
      const auto expected = color_of({}, world->light(), album.ray(i, 20, v), true);
      for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(album.rgb(i, 20, v)[k], expected[k], 0.51) << i << ' ' << v;
    }
  }
}

// Primitives of all kinds with random rotations, some of them around a camera, in a room or under the sky, with markers and
// triangles.
std::shared_ptr<const World> jumble(Random& random, bool with_room, bool with_mesh) {
  std::vector<Primitive> primitives;
  if (with_room) primitives.push_back(primitive(room, random.point(0.5F), {7.0F, 6.5F, 4.0F}));
  for (int i = 0; i < 18; ++i) {
    const auto size = [&] { return random.within(0.1F, 1.2F); };
    const PrimitiveKind kind = std::array{box, cylinder, capsule, sphere, plane, disc}[static_cast<std::size_t>(i) % 6];
    Vec3 half(size(), size(), size());
    if (kind != box && kind != plane) half.y() = half.x();
    if (kind == sphere) half.z() = half.x();
    if (kind == capsule) half.z() += half.x();
    if (kind == plane || kind == disc) half.z() = 0.0F;
    const bool aligned = kind == sphere || random.within(0.0F, 1.0F) < 0.5F;
    primitives.push_back(primitive(kind, random.point(4.0F), half, aligned ? Quat::Identity() : random.rotation()));
  }
  TriangleMesh mesh;
  for (int i = 0; with_mesh && i < 12; ++i) {
    const Vec3 middle = random.point(4.0F);
    for (int k = 0; k < 3; ++k) mesh.vertices.emplace_back(middle + random.point(1.0F));
    mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
    if (i > 0) mesh.triangles.push_back({3 * i - 1, 3 * i, 3 * i + 1});  // shares corners
  }
  Markers markers;
  markers.start = random.point(3.0F);
  markers.goal = random.point(3.0F);
  markers.waypoints = {random.point(3.0F), random.point(3.0F)};
  return colorful(std::move(primitives), std::move(markers), std::move(mesh));
}

TEST(GlRenderer, EveryKindFromOutsideAndInside) {
  NEEDS_RENDERER(renderer);
  Random random(5);
  std::vector<std::shared_ptr<const World>> worlds;
  for (int i = 0; i < 8; ++i) worlds.push_back(jumble(random, i % 2 == 0, i % 4 < 2));
  for (const DepthKind kind : {DepthKind::planar, DepthKind::range}) {
    CameraConfig camera = camera_of(40, 30, kind == DepthKind::planar ? 90.0F : 60.0F);
    camera.depth_kind = kind;
    camera.far_m = kind == DepthKind::planar ? 100.0F : 6.0F;
    Album album(camera);
    for (std::size_t i = 0; i < 24; ++i) {
      const World& world = *worlds[i % worlds.size()];
      // Some cameras are inside a primitive or a marker.
      Vec3 position = random.point(4.0F);
      if (i % 3 == 0) position = world.primitives()[1 + i / 3].center;
      if (i % 12 == 1) position = *world.markers().start;
      album.add(world, {position, random.rotation().toRotationMatrix()});
    }
    album.take(renderer);
    expect_true(album, 0.8);
  }
}

TEST(GlRenderer, FarAndThin) {
  NEEDS_RENDERER(renderer);
  std::vector<Primitive> primitives;
  Random random(3);
  for (int i = 0; i < 12; ++i) {
    const Quat turn(Eigen::AngleAxisf(random.within(-1.0F, 1.0F), Vec3::UnitX()));
    const auto y = static_cast<float>(3 * i - 18);
    primitives.push_back(primitive(i % 2 == 0 ? cylinder : capsule, {80 + y, y, 0}, {0.05F, 0.05F, 20}, turn));
  }
  const auto world = colorful(std::move(primitives));
  CameraConfig camera = camera_of(320, 16, 40.0F);
  camera.far_m = 500.0F;
  Album album(camera);
  album.add(*world);
  album.take(renderer);
  // Thin primitives are a few tenths of a pixel wide. Most pixels show sky, and every primitive must appear.
  expect_true(album, 0.6);
  std::vector<bool> found(13);
  for (const std::uint16_t instance : album.images.instance) found[instance] = true;
  EXPECT_GE(std::count(found.begin(), found.end(), true), 10);
}

TEST(GlRenderer, BothLayoutsAndGrey) {
  NEEDS_RENDERER(renderer);
  Random random(8);
  const auto world = jumble(random, true, true);
  CameraConfig camera = camera_of(37, 23);
  Album rows(camera);
  camera.layout = ImageLayout::chw;
  Album planes(camera);
  for (Album* album : {&rows, &planes}) {
    album->add(*world);
    album->add(*world, looking({0, 0, 0}, {-1, 1, 0.2F}));
    album->take(renderer);
  }
  const std::size_t pixels = rows.pixels();
  for (std::size_t i = 0; i < 2 * pixels; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t plane_at = (i / pixels * 3 + k) * pixels + i % pixels;
      ASSERT_EQ(rows.images.rgb[3 * i + k], planes.images.rgb[plane_at]);
      ASSERT_EQ(rows.images.normal[3 * i + k], planes.images.normal[plane_at]);
    }
    const std::uint8_t* rgb = rows.images.rgb.data() + 3 * i;
    ASSERT_EQ(rows.images.grey[i], static_cast<int>(std::floor(0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2] + 0.5)));
  }
}

// Outputs that a camera does not write must not affect the others.
TEST(GlRenderer, EachOutputAlone) {
  NEEDS_RENDERER(renderer);
  Random random(9);
  const auto world = jumble(random, false, true);
  CameraConfig camera = camera_of(31, 20);
  Album all(camera);
  all.add(*world);
  all.take(renderer);
  for (bool CameraOutputs::* output : {&CameraOutputs::rgb, &CameraOutputs::depth, &CameraOutputs::semantic,
                                       &CameraOutputs::instance, &CameraOutputs::normal, &CameraOutputs::grey}) {
    camera.outputs = {.rgb = false};
    camera.outputs.*output = true;
    Album one(camera);
    one.add(*world);
    one.take(renderer);
    const auto same_if_there = [](const auto& a, const auto& b) { return a.empty() || a == b; };
    EXPECT_TRUE(same_if_there(one.images.rgb, all.images.rgb));
    EXPECT_TRUE(same_if_there(one.images.depth, all.images.depth));
    EXPECT_TRUE(same_if_there(one.images.semantic, all.images.semantic));
    EXPECT_TRUE(same_if_there(one.images.instance, all.images.instance));
    EXPECT_TRUE(same_if_there(one.images.normal, all.images.normal));
    EXPECT_TRUE(same_if_there(one.images.grey, all.images.grey));
  }
}

TEST(GlRenderer, SamplesAreAveragedAsWritten) {
  NEEDS_RENDERER(renderer);
  Random random(10);
  const auto world = jumble(random, true, true);
  const Pose pose = looking({-3, 0, 0}, {0, 0, 0});
  for (const int side : {2, 3, 4}) {
    CameraConfig camera = camera_of(33, 21);
    camera.samples_per_pixel = side * side;
    Album smooth(camera);
    Album plain(camera_of(33, 21));
    Album fine(camera_of(33 * side, 21 * side));  // its pixels are the samples of `smooth`
    for (Album* album : {&smooth, &plain, &fine}) {
      album->add(*world, pose);
      album->take(renderer);
    }
    EXPECT_EQ(smooth.images.depth, plain.images.depth);
    EXPECT_EQ(smooth.images.instance, plain.images.instance);
    EXPECT_EQ(smooth.images.normal, plain.images.normal);
    for (int v = 0; v < 21; ++v) {
      for (int u = 0; u < 33; ++u) {
        for (std::size_t k = 0; k < 3; ++k) {
          int sum = 0;
          for (int i = 0; i < side * side; ++i) sum += fine.rgb(0, u * side + i % side, v * side + i / side)[k];
          ASSERT_EQ(smooth.rgb(0, u, v)[k], (2 * sum + side * side) / (2 * side * side)) << side << ": " << u << ' ' << v;
        }
      }
    }
  }
}

TEST(GlRenderer, ManyWorldsAndManyTilesAreEachTheirOwnPicture) {
  NEEDS_RENDERER(renderer);
  Random random(11);
  std::vector<std::shared_ptr<const World>> worlds;
  for (int i = 0; i < 5; ++i) worlds.push_back(jumble(random, i % 2 == 0, i % 3 == 0));
  // More rows than fit in any texture.
  Album album(camera_of(16, 32));
  for (std::size_t i = 0; i < 2500; ++i) {
    album.add(*worlds[i * i % worlds.size()], {random.point(3.0F), random.rotation().toRotationMatrix()});
  }
  album.take(renderer);
  for (std::size_t i = 0; i < album.requests.size(); i += i < 4 || i > 2490 ? 1 : 97) {
    Album alone(album.camera);
    const RenderRequest& request = album.requests[i];
    alone.add(*request.world, {request.position, request.rotation});
    alone.take(renderer);
    std::size_t same = 0;
    for (std::size_t k = 0; k < alone.pixels(); ++k) {
      const std::size_t at = i * alone.pixels() + k;
      same += alone.images.instance[k] == album.images.instance[at] &&
                      (std::isinf(alone.images.depth[k]) ||
                       std::abs(alone.images.depth[k] - album.images.depth[at]) <= 2e-5F * alone.images.depth[k])
                  ? 1
                  : 0;
    }
    // The tile's position in the atlas affects the rounding of corners, so edge pixels may differ.
    EXPECT_GE(same, alone.pixels() - 5) << i;
  }
}

TEST(GlRenderer, CamerasOfSeveralSizesAtOnce) {
  NEEDS_RENDERER(renderer);
  Random random(12);
  const auto world = jumble(random, true, false);
  Album wide(camera_of(50, 10));
  Album high(camera_of(10, 50));
  high.camera.outputs = {.rgb = false, .depth = true};
  for (int i = 0; i < 6; ++i) {
    wide.add(*world, {random.point(3.0F), random.rotation().toRotationMatrix()});
    high.add(*world, {random.point(3.0F), random.rotation().toRotationMatrix()});
  }
  wide.prepare();
  high.prepare();
  std::vector<RenderRequest> both;
  for (std::size_t i = 0; i < 6; ++i) {
    both.push_back(wide.requests[i]);
    both.push_back(high.requests[i]);
  }
  renderer.start(both);
  renderer.finish(wide.workers);
  const CameraImages together_wide = wide.images;
  const CameraImages together_high = high.images;
  wide.take(renderer);
  high.take(renderer);
  EXPECT_EQ(wide.images.rgb, together_wide.rgb);
  EXPECT_EQ(wide.images.depth, together_wide.depth);
  EXPECT_EQ(high.images.depth, together_high.depth);
}

TEST(GlRenderer, Shadows) {
  NEEDS_RENDERER(renderer);
  // A box above the ground shades the ground 1 m to its -x side. The sun stands at 45 degrees towards +x.
  SceneDescription description;
  description.light.sun_direction = {std::numbers::sqrt2_v<float> / 2, 0, std::numbers::sqrt2_v<float> / 2};
  description.primitives = {primitive(room, {0, 0, 5}, {9, 9, 5}), primitive(box, {0, 0, 1}, {0.2F, 0.2F, 0.2F})};
  description.markers.goal = Vec3(3, 0, 1);
  const World world(description);
  CameraConfig camera = camera_of(101, 101, 60.0F);
  camera.shadows = true;
  Album album(camera);
  Pose down;
  down.position = {0, 0, 6};
  down.rotation << 0, 0, 1, 0, 1, 0, -1, 0, 0;  // the image's top is +x
  album.add(world, down);
  album.take(renderer);
  const auto at = [&](float x, float y) {
    const auto pixel = [&](float offset) { return static_cast<int>(std::lround(50.0F - album.pinhole.fx * offset / 6.0F)); };
    return album.rgb(0, pixel(y), pixel(x));
  };
  const auto lit = at(-2, 1);
  EXPECT_LT(at(-1, 0)[0], lit[0]);
  EXPECT_LT(at(-0.9F, 0.1F)[0], lit[0]);
  EXPECT_EQ(at(-1, 0.3F), lit);
  EXPECT_EQ(at(-1.6F, 0), lit);
  EXPECT_EQ(at(2, 0), lit);  // the position below the goal: markers cast no shadow
  // The same point is lit if shadows are off.
  Album plain(camera_of(101, 101, 60.0F));
  plain.add(world, down);
  plain.take(renderer);
  EXPECT_EQ(plain.rgb(0, 50, 59), lit);
}

TEST(GlRenderer, ShadowsOfEveryKind) {
  NEEDS_RENDERER(renderer);
  Random random(17);
  std::vector<std::shared_ptr<const World>> worlds;
  for (int i = 0; i < 6; ++i) worlds.push_back(jumble(random, i % 2 == 0, i % 3 != 0));
  CameraConfig camera = camera_of(40, 30);
  camera.shadows = true;
  Album album(camera);
  for (std::size_t i = 0; i < 18; ++i) {
    album.add(*worlds[i % worlds.size()], {random.point(4.0F), random.rotation().toRotationMatrix()});
  }
  album.take(renderer);
  expect_true(album, 0.8);
}

// With several samples the image is larger than any texture, so it is drawn in parts.
TEST(GlRenderer, PictureLargerThanATexture) {
  NEEDS_RENDERER(renderer);
  Random random(13);
  const auto world = jumble(random, true, true);
  CameraConfig camera = camera_of(8192, 3);
  camera.outputs = {.rgb = true, .depth = true, .instance = true};
  Album plain(camera);
  camera.samples_per_pixel = 16;
  Album smooth(camera);
  for (Album* album : {&plain, &smooth}) {
    album->add(*world);
    album->take(renderer);
  }
  std::size_t close = 0;
  std::size_t same = 0;
  for (std::size_t i = 0; i < plain.pixels(); ++i) {
    const bool is_close = std::abs(int{plain.images.rgb[3 * i]} - int{smooth.images.rgb[3 * i]}) <= 2;
    close += is_close ? 1 : 0;
    same += plain.images.instance[i] == smooth.images.instance[i] ? 1 : 0;
  }
  EXPECT_GE(close, plain.pixels() * 98 / 100);
  EXPECT_GE(same, plain.pixels() * 999 / 1000);
}

TEST(GlRenderer, BigMeshIsCulledAndNothingIsLost) {
  NEEDS_RENDERER(renderer);
  // Terrain of 2 x 40 x 40 triangles, which takes several chunks.
  constexpr int kSide = 40;
  TriangleMesh mesh;
  Random random(14);
  for (int i = 0; i <= kSide; ++i) {
    for (int k = 0; k <= kSide; ++k) {
      mesh.vertices.emplace_back(static_cast<float>(i - kSide / 2), static_cast<float>(k - kSide / 2),
                                 random.within(-0.3F, 0.3F));
    }
  }
  for (int i = 0; i < kSide; ++i) {
    for (int k = 0; k < kSide; ++k) {
      const int a = i * (kSide + 1) + k;
      mesh.triangles.push_back({a, a + kSide + 1, a + 1});
      mesh.triangles.push_back({a + 1, a + kSide + 1, a + kSide + 2});
    }
  }
  const auto world = colorful({primitive(room, {0, 0, 0}, {30, 30, 30})}, {}, std::move(mesh));
  CameraConfig camera = camera_of(16, 12);
  Album album(camera);
  for (int i = 0; i < 3; ++i) {
    album.add(*world, {random.point(5.0F) + Vec3(0, 0, 6), random.rotation().toRotationMatrix()});
  }
  album.take(renderer);
  expect_true(album, 0.7);
  album.camera.shadows = true;
  album.take(renderer);
  expect_true(album, 0.6);
}

TEST(GlRenderer, SameRequestsAgainAllocateNothing) {
  NEEDS_RENDERER(renderer);
  const auto world = playground("camera-train-1");
  Album album(camera_of(64, 48));
  Random random(15);
  for (int i = 0; i < 40; ++i) album.add(*world, {Vec3(7, 7, 2) + random.point(1.5F), random.rotation().toRotationMatrix()});
  album.prepare();
  const auto take = [&] {
    renderer.start(album.requests);
    renderer.finish(album.workers);
  };
  for (int i = 0; i < 3; ++i) take();
  const std::uint64_t before = flockstep::testing::allocations_of_this_thread();
  for (int i = 0; i < 5; ++i) take();
  EXPECT_EQ(flockstep::testing::allocations_of_this_thread() - before, 0U);
}

TEST(GlRenderer, NothingToDo) {
  NEEDS_RENDERER(renderer);
  Workers workers(1);
  renderer.start({});
  renderer.finish(workers);
}

TEST(GlRenderer, StartedAndNeverFinished) {
  NEEDS_RENDERER(renderer);
  const auto world = playground("camera-train-1");
  Album album(camera_of(16, 32));
  for (int i = 0; i < 3000; ++i) album.add(*world, {Vec3(7, 7, 2), Mat3::Identity()});
  album.prepare();
  renderer.start(album.requests);  // more rounds than are read back ahead
  Album another(camera_of(24, 24));
  another.add(*world, {Vec3(7, 7, 2), Mat3::Identity()});
  another.take(renderer);
  EXPECT_NE(another.images.instance[0], 0);
  renderer.start(album.requests);
}

TEST(GlRenderer, ManyMadeAndDestroyedAndTwoAtOnce) {
  NEEDS_RENDERER(first);
  Random random(16);
  const auto world = jumble(random, true, true);
  Album expected(camera_of(24, 24));
  expected.add(*world);
  expected.take(first);
  for (int i = 0; i < 12; ++i) {
    GlRenderer another;
    Album album(expected.camera);
    Album again(expected.camera);
    album.add(*world);
    again.add(*world);
    album.prepare();
    again.prepare();
    another.start(album.requests);
    first.start(again.requests);
    another.finish(album.workers);
    first.finish(again.workers);
    EXPECT_EQ(album.images.depth, expected.images.depth);
    EXPECT_EQ(again.images.rgb, expected.images.rgb);
  }
}

TEST(GlRenderer, WithoutEglItReportsWhy) {
  const EglVariable variable("none");
  EXPECT_THROW(GlRenderer(), GlUnavailable);
  EXPECT_NE(message_of([] { GlRenderer renderer; }).find("FLOCKSTEP_EGL=none"), std::string::npos);
}

TEST(GlRenderer, UnknownDevicesAreRefused) {
  const EglVariable variable("please");
  EXPECT_NE(message_of([] { GlRenderer renderer; }).find("FLOCKSTEP_EGL"), std::string::npos);
}

TEST(GlRenderer, FailingAndHangingOnTheWay) {
  NEEDS_RENDERER(good);
  const auto world = playground("camera-train-1");
  const auto why_not = [&](GlRenderer& renderer) {
    Album album(camera_of(16, 16));
    album.add(*world);
    return message_of([&] { album.take(renderer); });
  };
  for (const auto& [fault, why] : {std::pair{FaultyDriver::Fault::error, "OpenGL failed with error 1285"},
                                   {FaultyDriver::Fault::hang, "the OpenGL driver did not answer within 200 ms"}}) {
    const FaultyDriver driver(fault);
    GlRenderer renderer(fault == FaultyDriver::Fault::hang ? std::chrono::milliseconds(200) : GlRenderer::kPatience);
    EXPECT_EQ(why_not(renderer), why);
    EXPECT_EQ(why_not(renderer), why);  // it stays unusable
  }
  {
    // The device fails in the second round while the caller writes the first. The images being read must stay valid.
    const FaultyDriver driver(FaultyDriver::Fault::error, 1);
    GlRenderer renderer;
    Album many(camera_of(16, 32));
    for (int i = 0; i < 5000; ++i) many.add(*world, {Vec3(7, 7, 2), Mat3::Identity()});
    EXPECT_THROW(many.take(renderer), GlUnavailable);
    EXPECT_NE(many.images.instance[0], 0);
    EXPECT_THROW(many.take(renderer), GlUnavailable);
  }
  Album album(camera_of(16, 16));
  album.add(*world, {Vec3(7, 7, 2), Mat3::Identity()});
  album.take(good);  // other renderers still work
  EXPECT_NE(album.images.instance[0], 0);
}

#if !defined(_WIN32)
TEST(GlRenderer, AForkedChildDoesNotUseIt) {
  NEEDS_RENDERER(renderer);
  const auto world = playground("camera-train-1");
  Album album(camera_of(16, 16));
  album.add(*world, {Vec3(7, 7, 2), Mat3::Identity()});
  auto shared = std::make_unique<GlRenderer>();
  album.take(*shared);
  const pid_t child = fork();
  if (child == 0) {
    bool refused = false;
    try {
      shared->start(album.requests);
    } catch (const GlUnavailable&) {
      refused = true;
    }
    shared.reset();
    _exit(refused ? 7 : 8);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 7);
  album.take(*shared);
  EXPECT_NE(album.images.instance[0], 0);
}
#endif

}  // namespace
}  // namespace flockstep::render
