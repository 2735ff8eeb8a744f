// How the cameras compare with the bare limits of the same pictures, from the same poses, on one thread.
//
// Bare Embree: for each camera, packets of neighbouring pixels through the world's triangles (primitives tessellated to 16-gons),
// shaded from Embree's normals by the engine's formula, colour and depth stored. The best of packets of 4 x 2 and 4 x 4 rays,
// coherent or incoherent. Engine: Batch::capture. All variants take turns within one run. Prints a JSON list of figures.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "camera.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <cstdint>

#include "bare_embree.hpp"

#ifndef SWIFTLET_BENCH_CAMERA_TYPES
#define SWIFTLET_BENCH_CAMERA_TYPES
namespace bench {

// What bare shading needs of a scene.
struct Paint {
  std::vector<std::array<float, 3>> colors;  // linear, of each triangle
  swiftlet::Light light;
  std::array<std::uint8_t, 1024> levels;  // encoded, by the square root of a linear value
};

// A 4 x 2 or 4 x 4 packet's rays that hit something, and where their pixels are.
struct Shaded {
  const float *dx, *dy, *dz, *nx, *ny, *nz;
  const unsigned int *triangle, *geometry;
  const float* t;
};

}  // namespace bench
#endif

HWY_BEFORE_NAMESPACE();
namespace bench::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// `count` pixels, a multiple of the lanes or less than them; rgb as count * 3 bytes.
void shade(const Paint& paint, const Shaded& rays, std::size_t count, std::uint8_t* rgb, float* depth) {
  const hn::CappedTag<float, 8> d;
  const hn::RebindToSigned<decltype(d)> di;
  alignas(64) float base[3][16];
  alignas(64) std::int32_t index[16];
  for (std::size_t i = 0; i < count; ++i) {
    if (rays.geometry[i] == RTC_INVALID_GEOMETRY_ID) continue;
    const auto& color = paint.colors[rays.triangle[i]];
    for (std::size_t c = 0; c < 3; ++c) base[c][i] = color[c];
  }
  const auto set = [&](float x) HWY_ATTR { return hn::Set(d, x); };
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    const auto hit = hn::RebindMask(d, hn::Ne(hn::Load(di, reinterpret_cast<const std::int32_t*>(rays.geometry + i)),
                                              hn::Set(di, static_cast<std::int32_t>(RTC_INVALID_GEOMETRY_ID))));
    const auto dx = hn::Load(d, rays.dx + i), dy = hn::Load(d, rays.dy + i), dz = hn::Load(d, rays.dz + i);
    auto nx = hn::Load(d, rays.nx + i), ny = hn::Load(d, rays.ny + i), nz = hn::Load(d, rays.nz + i);
    const auto towards = hn::MulAdd(nx, dx, hn::MulAdd(ny, dy, hn::Mul(nz, dz)));
    const auto length = hn::Sqrt(hn::MulAdd(nx, nx, hn::MulAdd(ny, ny, hn::Mul(nz, nz))));
    const auto scale = hn::CopySign(hn::Div(set(1.0F), length), hn::Neg(towards));
    nx = hn::Mul(nx, scale);
    ny = hn::Mul(ny, scale);
    nz = hn::Mul(nz, scale);
    const swiftlet::Light& light = paint.light;
    const auto& s = light.sun_direction;
    const auto sun = hn::Max(hn::MulAdd(nx, set(s[0]), hn::MulAdd(ny, set(s[1]), hn::Mul(nz, set(s[2])))), hn::Zero(d));
    const auto up = hn::MulAdd(nz, set(0.5F), set(0.5F));
    const auto ray_up = hn::Max(hn::Div(dz, hn::Sqrt(hn::MulAdd(dx, dx, hn::MulAdd(dy, dy, hn::Mul(dz, dz))))), hn::Zero(d));
    hn::StoreU(hn::IfThenElse(hit, hn::Load(d, rays.t + i), hn::Inf(d)), d, depth + i);
    for (std::size_t c = 0; c < 3; ++c) {
      const auto ambient = hn::MulAdd(up, set(light.sky_ambient[c] - light.ground_ambient[c]), set(light.ground_ambient[c]));
      const auto lit = hn::Mul(hn::Load(d, base[c] + i), hn::MulAdd(sun, set(light.sun_color[c]), ambient));
      const auto sky = hn::MulAdd(ray_up, set(light.zenith_color[c] - light.horizon_color[c]), set(light.horizon_color[c]));
      const auto root = hn::Sqrt(hn::Min(hn::IfThenElse(hit, lit, sky), set(1.0F)));
      hn::Store(hn::ConvertTo(di, hn::MulAdd(root, set(1023.0F), set(0.5F))), di, index + i);
      for (std::size_t k = i; k < i + hn::Lanes(d); ++k) rgb[3 * k + c] = paint.levels[static_cast<std::size_t>(index[k])];
    }
  }
}

}  // namespace bench::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "bench.hpp"
#include "mesh_world.hpp"
#include "swiftlet/batch.hpp"
#include "trace/scene.hpp"

namespace bench {
HWY_EXPORT(shade);
}  // namespace bench

namespace {

using swiftlet::Mat3;
using swiftlet::Quat;
using swiftlet::Vec3;

constexpr int kRuns = 7;

// The world's triangles with a colour each, markers among them, for the bare loop.
struct BareWorld {
  std::unique_ptr<bench::BareScene> scene;
  bench::Paint paint;

  explicit BareWorld(const swiftlet::World& world) {
    swiftlet::SceneDescription description;
    description.materials.assign(world.materials().begin(), world.materials().end());
    description.primitives.assign(world.primitives().begin(), world.primitives().end());
    description.mesh = world.triangles();
    const auto add_marker = [&](const Vec3& center, const std::array<float, 3>& color) {
      description.primitives.push_back({.kind = swiftlet::PrimitiveKind::sphere,
                                        .center = center,
                                        .half_extents = Vec3::Constant(world.markers().radius),
                                        .material = static_cast<std::uint16_t>(description.materials.size())});
      description.materials.push_back({.name = "marker" + std::to_string(description.materials.size()), .base_color = color});
    };
    if (world.markers().start) add_marker(*world.markers().start, {0.8F, 0.03F, 0.02F});
    if (world.markers().goal) add_marker(*world.markers().goal, {0.02F, 0.6F, 0.05F});
    const swiftlet::World solid(std::move(description));
    scene = bench::triangle_scene(solid);
    for (const std::uint16_t material : solid.mesh(bench::chord_error(solid)).materials) {
      paint.colors.push_back(solid.materials()[material].base_color);
    }
    paint.light = world.light();
    for (std::size_t i = 0; i < paint.levels.size(); ++i) {
      const double root = static_cast<double>(i) / 1023.0;
      paint.levels[i] = static_cast<std::uint8_t>(std::lround(255.0 * std::pow(root * root, 1.0 / 2.2)));
    }
  }
};

// Where a camera is, and the pictures of all.
struct BareCameras {
  int width, height;
  float fx, fy;
  std::vector<Vec3> position;
  std::vector<Mat3> rotation;
  std::vector<std::uint8_t> rgb;
  std::vector<float> depth;
};

template <class Packet, std::size_t kRows>
void render_bare(const BareWorld& world, BareCameras& cameras, bool coherent) {
  constexpr std::size_t kLanes = 4 * kRows;
  alignas(64) Packet packet{};
  alignas(64) std::array<int, kLanes> valid;
  valid.fill(-1);
  bench::Query query = bench::make_query(coherent);
  std::fill_n(packet.ray.mask, kLanes, 0xFFFFFFFFU);
  std::fill_n(packet.ray.tnear, kLanes, 0.05F);
  const auto width = static_cast<std::size_t>(cameras.width);
  const auto height = static_cast<std::size_t>(cameras.height);
  alignas(64) std::uint8_t rgb[3 * kLanes];
  alignas(64) float depth[kLanes];
  for (std::size_t camera = 0; camera < cameras.position.size(); ++camera) {
    const Vec3& origin = cameras.position[camera];
    const Mat3& rotation = cameras.rotation[camera];
    std::fill_n(packet.ray.org_x, kLanes, origin.x());
    std::fill_n(packet.ray.org_y, kLanes, origin.y());
    std::fill_n(packet.ray.org_z, kLanes, origin.z());
    for (std::size_t row = 0; row < height; row += kRows) {
      for (std::size_t column = 0; column < width; column += 4) {
        for (std::size_t i = 0; i < kLanes; ++i) {
          const float left = (0.5F * static_cast<float>(width) - static_cast<float>(column + i % 4) - 0.5F) / cameras.fx;
          const float up = (0.5F * static_cast<float>(height) - static_cast<float>(row + i / 4) - 0.5F) / cameras.fy;
          packet.ray.dir_x[i] = rotation(0, 0) + left * rotation(0, 1) + up * rotation(0, 2);
          packet.ray.dir_y[i] = rotation(1, 0) + left * rotation(1, 1) + up * rotation(1, 2);
          packet.ray.dir_z[i] = rotation(2, 0) + left * rotation(2, 1) + up * rotation(2, 2);
          packet.ray.tfar[i] = 100.0F;
          packet.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
        }
        bench::trace_packet(world.scene->scene, valid.data(), packet, query);
        HWY_DYNAMIC_DISPATCH(bench::shade)
        (world.paint,
         {packet.ray.dir_x, packet.ray.dir_y, packet.ray.dir_z, packet.hit.Ng_x, packet.hit.Ng_y, packet.hit.Ng_z,
          packet.hit.primID, packet.hit.geomID, packet.ray.tfar},
         kLanes, rgb, depth);
        for (std::size_t i = 0; i < kRows; ++i) {
          const std::size_t pixel = (camera * height + row + i) * width + column;
          std::memcpy(cameras.rgb.data() + 3 * pixel, rgb + 12 * i, 12);
          std::memcpy(cameras.depth.data() + pixel, depth + 4 * i, 16);
        }
      }
    }
  }
}

void bench_case(const std::string& name, const std::shared_ptr<const swiftlet::World>& world, const BareWorld& bare, int width,
                int height, int num_drones, bench::Figures& figures) {
  swiftlet::BatchConfig config;
  config.num_drones = num_drones;
  config.num_threads = 1;
  swiftlet::CameraConfig camera;
  camera.width_px = width;
  camera.height_px = height;
  camera.outputs.depth = true;
  config.cameras = {camera};
  swiftlet::Batch batch(config, {world});
  const auto n = static_cast<std::size_t>(num_drones);
  const std::size_t pixels = n * static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  BareCameras cameras{width, height, camera.fx(), camera.fy(), bench::free_positions(*world, num_drones, 1), {}, {}, {}};
  cameras.rgb.resize(3 * pixels);
  cameras.depth.resize(pixels);
  std::mt19937 random(2);
  std::vector<float> position, quat_wxyz;
  for (std::size_t i = 0; i < n; ++i) {
    const Vec3& p = cameras.position[i];
    const float yaw = std::uniform_real_distribution<float>(0.0F, 2.0F * std::numbers::pi_v<float>)(random);
    const float pitch = std::uniform_real_distribution<float>(-0.2F, 0.2F)(random);
    const Quat q(Eigen::AngleAxisf(yaw, Vec3::UnitZ()) * Eigen::AngleAxisf(pitch, Vec3::UnitY()));
    position.insert(position.end(), {p.x(), p.y(), p.z()});
    quat_wxyz.insert(quat_wxyz.end(), {q.w(), q.x(), q.y(), q.z()});
    cameras.rotation.push_back(q.toRotationMatrix());
  }
  batch.set_pose(position, quat_wxyz);

  const std::vector<bench::Variant> variants{
      {"raycast", [&] { batch.capture(0); }},
      {"bare Embree 4x2 coherent", [&] { render_bare<RTCRayHit8, 2>(bare, cameras, true); }},
      {"bare Embree 4x2 incoherent", [&] { render_bare<RTCRayHit8, 2>(bare, cameras, false); }},
      {"bare Embree 4x4 coherent", [&] { render_bare<RTCRayHit16, 4>(bare, cameras, true); }},
      {"bare Embree 4x4 incoherent", [&] { render_bare<RTCRayHit16, 4>(bare, cameras, false); }}};
  const swiftlet::trace::FlushDenormals flush;
  const bench::Times times = bench::interleave(variants, kRuns);
  std::size_t best = 1;
  for (std::size_t v = 0; v < variants.size(); ++v) {
    if (v > 1 && bench::median(times[v]) < bench::median(times[best])) best = v;
    std::fprintf(stderr, "  %-40s %-28s %10.1f frames/s\n", name.c_str(), variants[v].label.c_str(),
                 static_cast<double>(n) / bench::median(times[v]));
  }
  // The pictures must be of the same thing, or the comparison says nothing.
  std::size_t differ = 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    const float a = batch.images(0).depth[i], b = cameras.depth[i];
    differ += !(a == b || std::abs(a - b) < 0.02F * a);
  }
  if (differ > pixels / 25) {
    std::fprintf(stderr, "%s: %zu of %zu pixels show another depth\n", name.c_str(), differ, pixels);
    std::exit(1);
  }
  const std::string size = std::to_string(width) + 'x' + std::to_string(height) + 'x' + std::to_string(num_drones);
  const std::string figure = "camera/raycast/" + name + '/' + size;
  // Where Embree does all the tracing, its loop is the bare limit of the engine; where the engine traces primitives itself, no
  // more than a yardstick.
  const bool meshes = !world->triangles().triangles.empty();
  figures.add(figure + (meshes ? "/ratio_to_bare" : "/ratio_to_bare_embree"), bench::median_ratio(times[best], times[0]), "1",
              kRuns);
  figures.add(figure + "/frames_per_second", static_cast<double>(n) / bench::median(times[0]), "1/s", kRuns);
  figures.add(figure + "/bare_embree_frames_per_second", static_cast<double>(n) / bench::median(times[best]), "1/s", kRuns);
}

}  // namespace

int main() {
  bench::Figures figures;
  const std::vector<std::pair<std::string, std::shared_ptr<const swiftlet::World>>> worlds{
      {"playground", swiftlet::World::load(SWIFTLET_SCENES "/playground/camera-train-1.json")},
      {"mesh1k", bench::mesh_world(20, 20.0F)},
      {"mesh100k", bench::mesh_world(200, 60.0F)},
      {"mesh1M", bench::mesh_world(640, 180.0F)}};
  for (const auto& [name, world] : worlds) {
    const BareWorld bare(*world);
    for (const auto& [width, height, num_drones] : {std::array{64, 64, 256}, std::array{640, 480, 16}}) {
      bench_case(name, world, bare, width, height, num_drones, figures);
    }
  }
  figures.print();
}
#endif  // HWY_ONCE
