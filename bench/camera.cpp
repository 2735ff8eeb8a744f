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

constexpr int kRuns = 7;

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

// Camera poses and the images of all cameras.
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

constexpr float kFarM = 100.0F;

flockstep::CameraConfig rgb_and_depth(int width, int height) {
  flockstep::CameraConfig camera;
  camera.width_px = width;
  camera.height_px = height;
  camera.far_m = kFarM;
  camera.outputs.depth = true;
  return camera;
}

// Random drone poses in free space, with any yaw and a pitch of at most 0.2 rad.
struct Poses {
  std::vector<Vec3> points;
  std::vector<Quat> rotations;
  std::vector<float> position, quat_wxyz;  // same poses as plain arrays

  Poses(const flockstep::World& world, int count) : points(bench::free_positions(world, count, 1)) {
    std::mt19937 random(2);
    for (const Vec3& p : points) {
      const float yaw = std::uniform_real_distribution<float>(0.0F, 2.0F * std::numbers::pi_v<float>)(random);
      const float pitch = std::uniform_real_distribution<float>(-0.2F, 0.2F)(random);
      const Quat q(Eigen::AngleAxisf(yaw, Vec3::UnitZ()) * Eigen::AngleAxisf(pitch, Vec3::UnitY()));
      rotations.push_back(q);
      position.insert(position.end(), {p.x(), p.y(), p.z()});
      quat_wxyz.insert(quat_wxyz.end(), {q.w(), q.x(), q.y(), q.z()});
    }
  }
};

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

std::string size_of(int width, int height, int num_drones) {
  return std::to_string(width) + 'x' + std::to_string(height) + 'x' + std::to_string(num_drones);
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

void bench_case(const std::string& name, const std::shared_ptr<const flockstep::World>& world, const BareWorld& bare, int width,
                int height, int num_drones, bench::Figures& figures) {
  const flockstep::CameraConfig camera = rgb_and_depth(width, height);
  const Poses poses(*world, num_drones);
  const auto batch = make_batch(world, poses, camera, flockstep::CameraBackend::raycast);
  const auto embree = make_batch(world, poses, camera, flockstep::CameraBackend::raycast, flockstep::TracerKind::embree);
  const auto n = static_cast<std::size_t>(num_drones);
  const std::size_t pixels = n * static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  BareCameras cameras{width, height, camera.fx(), camera.fy(), poses.points, {}, {}, {}};
  for (const Quat& q : poses.rotations) cameras.rotation.push_back(q.toRotationMatrix());
  cameras.rgb.resize(3 * pixels);
  cameras.depth.resize(pixels);

  const auto gl = make_batch(world, poses, camera, flockstep::CameraBackend::gl);
  const std::vector<bench::Variant> variants{
      {"raycast", [&] { batch->camera(0).capture(); }},
      {"gl", [&] { gl->camera(0).capture(); }},
      {"bare Embree 4x2 coherent", [&] { render_bare<RTCRayHit8, 2>(bare, cameras, true); }},
      {"bare Embree 4x2 incoherent", [&] { render_bare<RTCRayHit8, 2>(bare, cameras, false); }},
      {"bare Embree 4x4 coherent", [&] { render_bare<RTCRayHit16, 4>(bare, cameras, true); }},
      {"bare Embree 4x4 incoherent", [&] { render_bare<RTCRayHit16, 4>(bare, cameras, false); }},
      {"through Embree", [&] { embree->camera(0).capture(); }}};
  const flockstep::FlushDenormals flush;
  const bench::Times times = bench::interleave(variants, kRuns);
  constexpr std::size_t kFirstBare = 2, kThroughEmbree = 6;
  std::size_t best = kFirstBare;
  for (std::size_t v = kFirstBare; v < kThroughEmbree; ++v) {
    if (bench::median(times[v]) < bench::median(times[best])) best = v;
  }
  for (std::size_t v = 0; v < variants.size(); ++v) {
    std::fprintf(stderr, "  %-12s %-28s %10.1f frames/s\n", name.c_str(), variants[v].label.c_str(),
                 static_cast<double>(n) / bench::median(times[v]));
  }
  const std::vector<float>& ours = batch->camera(0).images().depth;
  using Seen = std::pair<const char*, const std::vector<float>*>;
  for (const auto& [text, depth] : {Seen{"bare Embree", &cameras.depth}, Seen{"gl", &gl->camera(0).images().depth},
                                    Seen{"Embree", &embree->camera(0).images().depth}}) {
    const double share = share_that_differs(ours, *depth);
    if (share < 0.04) continue;
    std::fprintf(stderr, "%s: %s differs in depth from raycast in %.1f %% of the pixels\n", name.c_str(), text, 100.0 * share);
    std::exit(1);
  }
  const std::string size = name + '/' + size_of(width, height, num_drones) + '/';
  const auto rate = [&](std::size_t v) { return static_cast<double>(n) / bench::median(times[v]); };
  const auto add = [&](const std::string& backend, std::size_t variant, const std::string& ratio) {
    const std::string figure = "camera/" + backend + '/' + size;
    figures.add(figure + ratio, bench::median_ratio(times[best], times[variant]), "1", kRuns);
    figures.add(figure + "frames_per_second", rate(variant), "1/s", kRuns);
    figures.add("camera_table/" + size + backend + "_frames_per_second", rate(variant), "1/s", kRuns);
  };
  // On triangles Embree's loop does the same work. On primitives it serves only as a reference.
  const bool meshes = !world->triangles().triangles.empty();
  const std::string ratio = meshes ? "ratio_to_bare" : "ratio_to_bare_embree";
  add("raycast", 0, ratio);
  figures.add("camera/raycast/" + size + "bare_embree_frames_per_second", rate(best), "1/s", kRuns);
  if (meshes) add("embree", kThroughEmbree, ratio);
  add("gl", 1, "ratio_to_bare_embree");
}

// Image sizes and batch sizes for the comparison with the bare loops.
constexpr std::array<std::array<int, 3>, 2> kCases{{{64, 64, 256}, {640, 480, 16}}};

// Measures frames per second by resolution, number of drones, world and backend. Skips the cases that bench_case covers.
void bench_table(const std::string& name, const std::shared_ptr<const flockstep::World>& world, bench::Figures& figures) {
  constexpr int kTableRuns = 5;
  constexpr long long kMaxPixels = 5'000'000;
  for (const auto& [width, height] : {std::pair{64, 64}, {128, 128}, {320, 240}, {640, 480}}) {
    for (const int num_drones : {1, 16, 256}) {
      if (static_cast<long long>(width) * height * num_drones > kMaxPixels) continue;
      if (std::find(kCases.begin(), kCases.end(), std::array{width, height, num_drones}) != kCases.end()) continue;
      const Poses poses(*world, num_drones);
      const flockstep::CameraConfig camera = rgb_and_depth(width, height);
      const auto raycast = make_batch(world, poses, camera, flockstep::CameraBackend::raycast);
      const auto gl = make_batch(world, poses, camera, flockstep::CameraBackend::gl);
      const bench::Times times = bench::interleave(
          {{"raycast", [&] { raycast->camera(0).capture(); }}, {"gl", [&] { gl->camera(0).capture(); }}}, kTableRuns);
      const std::string size = size_of(width, height, num_drones);
      for (std::size_t v = 0; v < 2; ++v) {
        const char* const backend = v == 0 ? "raycast" : "gl";
        const double rate = num_drones / bench::median(times[v]);
        std::fprintf(stderr, "  %-12s %-12s %-8s %10.1f frames/s\n", name.c_str(), size.c_str(), backend, rate);
        figures.add("camera_table/" + name + '/' + size + '/' + backend + "_frames_per_second", rate, "1/s", kTableRuns);
      }
    }
  }
}

}  // namespace

// The argument selects the part to run: "bare" or "table". Without it both run.
int main(int argc, char** argv) {
  const std::string part = argc > 1 ? argv[1] : "";
  const auto asked = [&](const char* name) { return part.empty() || part == name; };
  bench::Figures figures;
  const std::vector<std::pair<std::string, std::shared_ptr<const flockstep::World>>> worlds{
      {"playground", flockstep::World::load(FLOCKSTEP_SCENES "/playground/camera-train-1.json")},
      {"mesh1k", bench::mesh_world(20, 20.0F)},
      {"mesh100k", bench::mesh_world(200, 60.0F)},
      {"mesh1M", bench::mesh_world(640, 180.0F)}};
  for (const auto& [name, world] : worlds) {
    if (!asked("bare")) break;
    const BareWorld bare(*world);
    for (const auto& [width, height, num_drones] : kCases) bench_case(name, world, bare, width, height, num_drones, figures);
  }
  for (const auto& [name, world] : worlds) {
    if (asked("table")) bench_table(name, world, figures);
  }
  figures.print();
}
#endif  // HWY_ONCE
