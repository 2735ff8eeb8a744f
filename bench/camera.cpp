// Compares the cameras with a bare renderer that produces the same images from the same poses, on one thread.
//
// Bare Embree: for each camera, packets of neighbouring pixels are traced through the world's triangles (primitives tessellated
// to 16-gons). They are shaded from Embree's normals with the engine's formula, and colour and depth are stored. The best of
// packets of 4 x 2 and 4 x 4 rays, coherent or incoherent, counts. Engine: Batch::capture. All variants run in turns. Prints a
// JSON list of figures.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "camera.cpp"
#include <hwy/foreach_target.h>
// Highway's headers must come after foreach_target.
#include <hwy/highway.h>

#include <cstdint>

#include "bare_embree.hpp"

#ifndef FLOCKSTEP_BENCH_CAMERA_TYPES
#define FLOCKSTEP_BENCH_CAMERA_TYPES
namespace bench {

// The scene data for bare shading.
struct Paint {
  std::vector<std::array<float, 3>> colors;  // linear, one per triangle
  flockstep::Light light;
  std::array<std::uint8_t, 1024> levels;  // encoded levels, indexed by the square root of a linear value
};

// The rays of a 4 x 2 or 4 x 4 packet that hit something, and their pixels.
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

// Shades `count` pixels, a multiple of the lane count or less than it. rgb has count * 3 bytes.
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
    const flockstep::Light& light = paint.light;
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
#include <cstdlib>
#include <cstring>
#include <functional>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "base/platform.hpp"
#include "bench.hpp"
#include "flockstep/batch.hpp"
#include "mesh_world.hpp"
#include "render/appearance.hpp"
#include "trace/scene.hpp"

namespace bench {
HWY_EXPORT(shade);
}  // namespace bench

namespace {

using flockstep::Mat3;
using flockstep::Quat;
using flockstep::Vec3;

constexpr int kRuns = 5;

// A world's triangles with one colour each, including its markers, for the bare loop.
struct BareWorld {
  std::unique_ptr<bench::BareScene> scene;
  bench::Paint paint;

  explicit BareWorld(const flockstep::World& world) {
    flockstep::SceneDescription description;
    description.materials.assign(world.materials().begin(), world.materials().end());
    description.primitives.assign(world.primitives().begin(), world.primitives().end());
    description.mesh = world.triangles();
    const auto add_marker = [&](const Vec3& center, const std::array<float, 3>& color) {
      description.primitives.push_back({.kind = flockstep::PrimitiveKind::sphere,
                                        .center = center,
                                        .half_extents = Vec3::Constant(world.markers().radius),
                                        .material = static_cast<std::uint16_t>(description.materials.size())});
      description.materials.push_back({.name = "marker" + std::to_string(description.materials.size()), .base_color = color});
    };
    if (world.markers().start) add_marker(*world.markers().start, flockstep::render::kStartColor);
    if (world.markers().goal) add_marker(*world.markers().goal, flockstep::render::kGoalColor);
    const flockstep::World solid(std::move(description));
    scene = bench::triangle_scene(solid);
    const flockstep::TriangleMesh mesh = solid.mesh(bench::chord_error(solid));
    for (const std::uint16_t material : mesh.materials) paint.colors.push_back(solid.materials()[material].base_color);
    paint.light = world.light();
    for (std::size_t i = 0; i < paint.levels.size(); ++i) {
      const double root = static_cast<double>(i) / 1023.0;
      paint.levels[i] = static_cast<std::uint8_t>(std::lround(255.0 * std::pow(root * root, 1.0 / 2.2)));
    }
  }
};

// Random drone poses in free space, with any yaw and a pitch of at most 0.2 rad.
struct Poses {
  std::vector<Vec3> points;
  std::vector<Mat3> rotations;
  std::vector<float> position, quat_wxyz;  // same poses as plain arrays

  Poses(const flockstep::World& world, int count) : points(bench::free_positions(world, count, 1)) {
    std::mt19937 random(2);
    for (const Vec3& p : points) {
      const float yaw = std::uniform_real_distribution<float>(0.0F, 2.0F * std::numbers::pi_v<float>)(random);
      const float pitch = std::uniform_real_distribution<float>(-0.2F, 0.2F)(random);
      const Quat q(Eigen::AngleAxisf(yaw, Vec3::UnitZ()) * Eigen::AngleAxisf(pitch, Vec3::UnitY()));
      rotations.push_back(q.toRotationMatrix());
      position.insert(position.end(), {p.x(), p.y(), p.z()});
      quat_wxyz.insert(quat_wxyz.end(), {q.w(), q.x(), q.y(), q.z()});
    }
  }
};

// The images of all cameras.
struct BareCameras {
  flockstep::CameraConfig config;
  const Poses& poses;
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
  const auto width = static_cast<std::size_t>(cameras.config.width_px);
  const auto height = static_cast<std::size_t>(cameras.config.height_px);
  const float fx = cameras.config.fx(), fy = cameras.config.fy();
  alignas(64) std::uint8_t rgb[3 * kLanes];
  alignas(64) float depth[kLanes];
  for (std::size_t camera = 0; camera < cameras.poses.points.size(); ++camera) {
    const Vec3& origin = cameras.poses.points[camera];
    const Mat3& rotation = cameras.poses.rotations[camera];
    std::fill_n(packet.ray.org_x, kLanes, origin.x());
    std::fill_n(packet.ray.org_y, kLanes, origin.y());
    std::fill_n(packet.ray.org_z, kLanes, origin.z());
    for (std::size_t row = 0; row < height; row += kRows) {
      for (std::size_t column = 0; column < width; column += 4) {
        for (std::size_t i = 0; i < kLanes; ++i) {
          const float left = (0.5F * static_cast<float>(width) - static_cast<float>(column + i % 4) - 0.5F) / fx;
          const float up = (0.5F * static_cast<float>(height) - static_cast<float>(row + i / 4) - 0.5F) / fy;
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

constexpr float kFarM = 100.0F;

flockstep::CameraConfig rgb_and_depth(int width, int height) {
  flockstep::CameraConfig camera;
  camera.width_px = width;
  camera.height_px = height;
  camera.far_m = kFarM;
  camera.outputs.depth = true;
  return camera;
}

std::unique_ptr<flockstep::Batch> make_batch(const std::shared_ptr<const flockstep::World>& world, const Poses& poses,
                                             const flockstep::CameraConfig& camera, flockstep::CameraBackend backend,
                                             flockstep::TracerKind tracer = flockstep::TracerKind::automatic) {
  flockstep::BatchConfig config;
  config.tracer = tracer;
  config.num_envs = static_cast<int>(poses.points.size());
  config.num_threads = 1;
  config.cameras = {camera};
  config.camera_backend = backend;
  auto batch = std::make_unique<flockstep::Batch>(config, flockstep::Batch::Worlds{world});
  if (const std::string warning = batch->take_warning(); !warning.empty()) {
    std::fprintf(stderr, "%s\n", warning.c_str());
    std::exit(1);
  }
  batch->set_pose(poses.position, poses.quat_wxyz);
  return batch;
}

// Returns the share of pixels whose depth differs from another renderer's. A comparison is only valid if both render the same
// scene.
double share_that_differs(const std::vector<float>& ours, const std::vector<float>& theirs) {
  std::size_t differ = 0;
  for (std::size_t i = 0; i < ours.size(); ++i) {
    differ += !(ours[i] == theirs[i] || std::abs(ours[i] - theirs[i]) < 0.02F * ours[i]);
  }
  return static_cast<double>(differ) / static_cast<double>(ours.size());
}

struct Size {
  int width, height, num_drones;
  long long pixels() const { return static_cast<long long>(width) * height * num_drones; }
  std::string text() const { return std::to_string(width) + 'x' + std::to_string(height) + 'x' + std::to_string(num_drones); }
};

// Measures frames per second. bare: the world for the bare loop, beside which raycast stands with its own tiles and through
// Embree; on triangles that loop does the same work, on primitives it serves as a reference.
void bench_case(const std::string& name, const std::shared_ptr<const flockstep::World>& world, const BareWorld* bare,
                bool with_gl, const Size& size, bench::Figures& figures) {
  using flockstep::CameraBackend, flockstep::TracerKind;
  const flockstep::CameraConfig camera = rgb_and_depth(size.width, size.height);
  const Poses poses(*world, size.num_drones);
  struct Engine {
    std::string name;
    std::unique_ptr<flockstep::Batch> batch;
    const std::vector<float>& depth() const { return batch->camera(0).images().depth; }
  };
  std::vector<Engine> engines;
  engines.push_back({"raycast", make_batch(world, poses, camera, CameraBackend::raycast)});
  if (bare != nullptr)
    engines.push_back({"embree", make_batch(world, poses, camera, CameraBackend::raycast, TracerKind::embree)});
  if (with_gl) engines.push_back({"gl", make_batch(world, poses, camera, CameraBackend::gl)});
  std::vector<bench::Variant> variants;
  for (const Engine& engine : engines) variants.push_back({engine.name, [&engine] { engine.batch->camera(0).capture(); }});
  BareCameras cameras{camera, poses, {}, {}};
  if (bare != nullptr) {
    cameras.rgb.resize(static_cast<std::size_t>(3 * size.pixels()));
    cameras.depth.resize(static_cast<std::size_t>(size.pixels()));
    for (const bool coherent : {true, false}) {
      const std::string flag = coherent ? " coherent" : " incoherent";
      variants.push_back({"bare Embree 4x2" + flag, [&, coherent] { render_bare<RTCRayHit8, 2>(*bare, cameras, coherent); }});
      variants.push_back({"bare Embree 4x4" + flag, [&, coherent] { render_bare<RTCRayHit16, 4>(*bare, cameras, coherent); }});
    }
  }
  const flockstep::FlushDenormals flush;
  const bench::Times times = bench::interleave(variants, kRuns);
  const std::string at = '/' + name + '/' + size.text() + '/';
  bench::print_rates(at, variants, times, size.num_drones, "frames/s");
  const auto require_alike = [&](const std::string& other, const std::vector<float>& depth) {
    const double share = share_that_differs(engines[0].depth(), depth);
    if (share < 0.04) return;
    std::fprintf(stderr, "%s%s differs in depth from raycast in %.1f %% of the pixels\n", at.c_str(), other.c_str(),
                 100.0 * share);
    std::exit(1);
  };
  const auto rate = [&](std::size_t v) { return bench::rates(times[v], size.num_drones); };
  const std::size_t best = bench::fastest(times, engines.size(), variants.size());
  for (std::size_t v = 0; v < engines.size(); ++v) {
    const std::string figure = "camera/" + engines[v].name + at;
    figures.add(figure + "frames_per_second", rate(v), "1/s");
    if (bare == nullptr) continue;
    require_alike(engines[v].name, engines[v].depth());
    figures.add(figure + "ratio_to_bare_embree", bench::ratios(times[best], times[v]), "1");
  }
  if (bare == nullptr) return;
  require_alike("bare Embree", cameras.depth);
  figures.add("camera/raycast" + at + "bare_embree_frames_per_second", rate(best), "1/s");
}

}  // namespace

// Without arguments all sizes in all worlds, the usual ones also beside the bare loop. With "table" none of them is. With "sweep"
// and numbers of drones, only 64 x 64 pixels in a playground, beside the bare loop.
int main(int argc, char** argv) {
  const std::string part = argc > 1 ? argv[1] : "";
  bench::Figures figures;
  const auto playground = flockstep::World::load(FLOCKSTEP_SCENES "/playground/camera-train-1.json");
  if (part == "sweep") {
    const BareWorld bare(*playground);
    for (int i = 2; i < argc; ++i) bench_case("playground", playground, &bare, false, {64, 64, std::atoi(argv[i])}, figures);
    figures.print();
    return 0;
  }
  const std::vector<std::pair<std::string, std::shared_ptr<const flockstep::World>>> worlds{
      {"playground", playground},
      {"mesh1k", bench::mesh_world(20, 20.0F)},
      {"mesh100k", bench::mesh_world(200, 60.0F)},
      {"mesh1M", bench::mesh_world(640, 180.0F)}};
  constexpr long long kMaxPixels = 5'000'000;
  for (const auto& [name, world] : worlds) {
    const BareWorld bare(*world);
    for (const auto& [width, height] : {std::pair{64, 64}, {128, 128}, {320, 240}, {640, 480}}) {
      for (const int num_drones : {1, 16, 256}) {
        const Size size{width, height, num_drones};
        const bool is_usual = (width == 64 && num_drones == 256) || (width == 640 && num_drones == 16);
        if (size.pixels() > kMaxPixels) continue;
        bench_case(name, world, is_usual && part != "table" ? &bare : nullptr, true, size, figures);
      }
    }
  }
  figures.print();
}
#endif  // HWY_ONCE
