// The SIMD kernels give the same bits on every target. Their results for random rays are compared with constants in this file,
// not with another run. Worlds and rays use only integers and correctly rounded operations in an order that no library chooses,
// so they also have the same bits everywhere. Triangles are not covered, because Embree traces those.

#include <bit>

#include "base/platform.hpp"
#include "base/random.hpp"
#include "batch_helpers.hpp"
#include "prepared/prepared_world.hpp"
#include "render/raycast/raycast_renderer.hpp"
#include "tasks/terms.hpp"
#include "trace/ray_block.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"
#include "trace/user_geometry.hpp"

namespace flockstep {
namespace {

using namespace testing;

constexpr std::size_t kRays = trace::kMaxRays;  // per block and per bundle

// FNV-1a over words.
class Digest {
 public:
  void add(std::uint64_t word) { value_ = (value_ ^ word) * 0x100000001B3ULL; }
  void add(float value) { add(std::uint64_t{std::bit_cast<std::uint32_t>(value)}); }
  void add(double value) { add(std::bit_cast<std::uint64_t>(value)); }
  template <class Rays>
  void add(const Rays& rays) {
    for (std::size_t i = 0; i < rays.count; ++i) {
      add(rays.t_hit[i]);
      add(static_cast<std::uint64_t>(static_cast<std::uint32_t>(rays.element[i])));
      hits_ += rays.element[i] >= 0 ? 1 : 0;
    }
  }
  std::uint64_t value() const { return value_; }
  std::size_t hits() const { return hits_; }

 private:
  std::uint64_t value_ = 0xCBF29CE484222325ULL;
  std::size_t hits_ = 0;
};

class Exact {
 public:
  explicit Exact(std::uint32_t seed) : seed_(seed) {}

  std::uint32_t word() { return philox4x32({next_++, 0, 0, 0}, {seed_, 0})[0]; }
  float within(float low, float high) { return low + (high - low) * uniform01(word()); }
  Vec3 point(float reach) {
    Vec3 p;
    for (float& coordinate : p) coordinate = within(-reach, reach);
    return p;
  }

  Quat rotation() {
    const float w = within(0.1F, 1.0F);
    const Vec3 v = point(1.0F);
    const float length = std::sqrt(((w * w + v.x() * v.x()) + v.y() * v.y()) + v.z() * v.z());
    return {w / length, v.x() / length, v.y() / length, v.z() / length};
  }

  // Some directions lie in a coordinate plane. Others are so close to an axis that the squares of their other components are
  // denormal. With `ahead` > 1 all directions are near +x.
  Vec3 direction(float ahead = 0.0F) {
    for (;;) {
      Vec3 v = point(1.0F);
      v.x() += ahead;
      const int axis = ahead > 0.0F ? 0 : static_cast<int>(word() % 3);
      const std::uint32_t sort = word() % 4;
      if (sort == 0) v[(axis + 1) % 3] *= 0.0F;
      if (sort == 1) {
        v[(axis + 1) % 3] *= 0x1p-71F;
        v[(axis + 2) % 3] *= 0x1p-71F;
      }
      const float length = std::sqrt((v.x() * v.x() + v.y() * v.y()) + v.z() * v.z());
      if (!(length > 0.25F)) continue;
      for (float& coordinate : v) coordinate /= length;
      return v;
    }
  }

  // Makes a world with primitives of every kind, about half of them rotated.
  std::shared_ptr<const World> world(int count) {
    std::vector<Primitive> primitives{primitive(PrimitiveKind::room, point(0.5F), {7.0F, 7.0F, 6.0F})};
    for (int i = 0; i < count; ++i) {
      const auto kind = static_cast<PrimitiveKind>(1 + i % 6);
      const Vec3 center = point(5.0F);
      const float r = within(0.2F, 1.5F);
      const float s = within(0.2F, 1.5F);
      Vec3 half(r, r, r + s);  // cylinder, capsule
      if (kind == PrimitiveKind::box) half.y() = s;
      if (kind == PrimitiveKind::sphere) half.z() = r;
      if (kind == PrimitiveKind::plane) half = {r, s, 0.0F};
      if (kind == PrimitiveKind::disc) half.z() = 0.0F;
      const bool turned = kind != PrimitiveKind::sphere && word() % 2 == 0;
      primitives.push_back(primitive(kind, center, half, turned ? rotation() : Quat::Identity()));
    }
    return make_world(std::move(primitives));
  }

 private:
  std::uint32_t seed_, next_ = 0;
};

void expect_digest(const Digest& digest, std::uint64_t expected) {
  EXPECT_EQ(digest.value(), expected) << std::hex << "0x" << digest.value() << " on " << trace::simd_target();
}

// Rays with arbitrary origins: 64 worlds with 8 blocks each.
Digest trace_blocks(int primitives) {
  Exact exact(static_cast<std::uint32_t>(primitives));
  const FlushDenormals flush;
  const auto tracer = std::make_unique<trace::Tracer>();
  trace::RayBlock& block = tracer->block();
  block.count = kRays;
  Digest digest;
  for (int i = 0; i < 64; ++i) {
    const auto world = exact.world(primitives);
    for (int portion = 0; portion < 8; ++portion) {
      for (std::size_t ray = 0; ray < kRays; ++ray) {
        const Vec3 origin = exact.point(8.0F);
        const Vec3 direction = exact.direction();
        block.org_x[ray] = origin.x();
        block.org_y[ray] = origin.y();
        block.org_z[ray] = origin.z();
        block.dir_x[ray] = direction.x();
        block.dir_y[ray] = direction.y();
        block.dir_z[ray] = direction.z();
        block.range[ray] = exact.within(1.0F, 20.0F);
      }
      tracer->trace_block(prepared(*world).scene());
      digest.add(block);
    }
  }
  EXPECT_GT(digest.hits(), 64 * 8 * kRays / 4);
  return digest;
}

TEST(KernelBits, FewPrimitives) { expect_digest(trace_blocks(6), 0x014BEF39B722AA74ULL); }

TEST(KernelBits, ManyPrimitives) { expect_digest(trace_blocks(60), 0x121905830F862757ULL); }

// Rays with a common origin. Gathering, view culling and the sensor's pose must not affect the bits.
TEST(KernelBits, Bundles) {
  Exact exact(1);
  const FlushDenormals flush;
  const auto candidates = std::make_unique<trace::CandidateSet>();
  const auto bundle = std::make_unique<trace::RayBundle>();
  std::vector<float> x(kRays + trace::kRayPadding), y(x), z(x);
  bundle->x = x.data();
  bundle->y = y.data();
  bundle->z = z.data();
  bundle->count = kRays;
  Digest digest;
  for (int i = 0; i < 64; ++i) {
    const auto world = exact.world(20);
    for (int portion = 0; portion < 8; ++portion) {
      for (std::size_t ray = 0; ray < kRays; ++ray) {
        const Vec3 direction = exact.direction(portion % 2 == 0 ? 2.0F : 0.0F);
        x[ray] = direction.x();
        y[ray] = direction.y();
        z[ray] = direction.z();
      }
      const trace::Frustum frustum =
          trace::make_frustum(std::span(x).first(kRays), std::span(y).first(kRays), std::span(z).first(kRays));
      bundle->frustum = &frustum;
      bundle->origin = exact.point(6.0F);
      bundle->rotation = exact.rotation().toRotationMatrix();
      bundle->range = exact.within(2.0F, 8.0F);
      prepared(*world).scene().gather(bundle->origin, 0.0F, bundle->range, false, *candidates);
      ASSERT_TRUE(trace_direct(std::span(candidates->list).first(candidates->count), trace::kMaxDirect, *bundle));
      digest.add(*bundle);
    }
  }
  EXPECT_GT(digest.hits(), 64 * 8 * kRays / 4);
  expect_digest(digest, 0x523952D09D73F4EEULL);
}

TEST(KernelBits, Ranges) {
  Exact exact(2);
  Digest digest;
  for (std::size_t count = 1; count < 300; ++count) {
    std::vector<float> ranges(count), normalised(count);
    for (float& range : ranges) range = exact.word() % 8 == 0 ? std::numeric_limits<float>::infinity() : exact.within(0.0F, 3.0F);
    task::normalise(ranges, 3.0F, normalised.data());
    const task::ScanClearance clearance = task::clearance_of(ranges, 3.0F);
    for (const float value : normalised) digest.add(value);
    digest.add(clearance.nearest);
    digest.add(clearance.sum);
  }
  expect_digest(digest, 0x787DCAA7375CDD5CULL);
}

// Few objects, many objects, markers, shadows, several samples per pixel, and all outputs.
TEST(KernelBits, Pictures) {
  constexpr std::size_t kPixels = 37 * 21;
  constexpr CameraOutputs kAll{.rgb = true, .depth = true, .semantic = true, .instance = true, .normal = true, .grey = true};
  Exact exact(3);
  const FlushDenormals flush;
  const auto scratch = std::make_unique<render::RaycastScratch>();
  std::vector<std::uint8_t> rgb(3 * kPixels), grey(kPixels);
  std::vector<float> depth(kPixels), normal(3 * kPixels);
  std::vector<std::uint16_t> semantic(kPixels), instance(kPixels);
  Digest digest;
  std::size_t seen = 0;
  for (const int primitives : {4, 12, 60, 700}) {
    for (int i = 0; i < 8; ++i) {
      SceneDescription description;
      const auto plain = exact.world(primitives);
      description.primitives.assign(plain->primitives().begin(), plain->primitives().end());
      description.markers = {.start = exact.point(3.0F), .goal = exact.point(3.0F)};
      const World world(description);
      const CameraConfig camera{.width_px = 37,
                                .height_px = 21,
                                .near_m = 0.125F,
                                .outputs = kAll,
                                .depth_kind = i % 2 == 0 ? DepthKind::planar : DepthKind::range,
                                .samples_per_pixel = i % 4 == 1 ? 4 : 1,
                                .shadows = i % 4 >= 2};
      const render::CameraOptics optics = render::make_camera_optics(camera);
      const Vec3 place = exact.point(2.0F);
      const render::RenderRequest request{
          &world,
          &prepared(world).scene(),
          &prepared(world).shading(camera.shadows),
          &camera,
          &optics,
          place,
          exact.rotation().toRotationMatrix(),
          {rgb.data(), depth.data(), semantic.data(), instance.data(), normal.data(), grey.data()}};
      render::render_tiles(request, 0, optics.tiles.size(), *scratch);
      for (const std::uint8_t value : rgb) digest.add(std::uint64_t{value});
      for (const float value : depth) digest.add(value);
      for (const std::uint16_t value : semantic) digest.add(std::uint64_t{value});
      for (const std::uint16_t value : instance) digest.add(std::uint64_t{value});
      for (const float value : normal) digest.add(value);
      for (const std::uint8_t value : grey) digest.add(std::uint64_t{value});
      for (const float value : depth) seen += std::isfinite(value) ? 1 : 0;
    }
  }
  EXPECT_GT(seen, 4 * 8 * kPixels / 2);
  expect_digest(digest, 0x134A4283E4A039C8ULL);
}

#if defined(__aarch64__)
TEST(KernelBits, OfNeon) { EXPECT_STREQ(trace::simd_target(), "NEON"); }
#endif

}  // namespace
}  // namespace flockstep
