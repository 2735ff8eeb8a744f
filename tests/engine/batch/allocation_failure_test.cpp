// Lets every single allocation of loading, batch construction, snapshot and restore fail in turn.

#include <exception>

#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/lsan_interface.h>
#endif

#include "allocation_counter.hpp"
#include "batch_helpers.hpp"
#include "prepared/prepared_world.hpp"
#include "trace/scene.hpp"

namespace flockstep {
namespace {

using namespace testing;

// Runs f with its first, second, ... allocation failing, until f needs fewer allocations. Returns how many runs threw. f must
// free everything it allocates. A run may succeed if the code can do without the memory, as std::stable_sort does.
enum class Kept : std::uint8_t { nothing, by_embree };
template <class F>
std::uint64_t fail_each(const F& f, Kept kept = Kept::nothing) {
  f();  // warms up one-time allocations
  f();
  std::uint64_t thrown = 0;
  for (std::uint64_t n = 1;; ++n) {
    const std::int64_t before = live_allocations();
    {
      const FailingAllocation failing(n);
      try {
        f();
      } catch (const std::exception&) {
        ++thrown;
      }
      if (!failing.has_failed()) return thrown;
    }
    if (kept == Kept::nothing) {
      EXPECT_EQ(live_allocations(), before) << "after allocation " << n;
    }
    if (::testing::Test::HasFailure()) return thrown;
  }
}

BatchConfig small_batch() {
  BatchConfig config = lidar_batch(3, {.beams = 5});
  config.pose_sensor.position_noise_std_m = 0.01F;
  config.cameras = {{.width_px = 8, .height_px = 6, .outputs = {.depth = true}}};
  return config;
}

class AllocationFailure : public ::testing::Test {
 protected:
  void SetUp() override {
    const std::uint64_t before = allocations();
    ::operator delete(::operator new(1));
    if (allocations() == before) GTEST_SKIP() << "the thread sanitizer keeps its own operator new";
  }
};

TEST_F(AllocationFailure, OfLoading) {
  const std::filesystem::path folder = ::testing::TempDir() + "flockstep_allocations";
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "a.obj") << "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3 4\nf 1 2 4\n";
  std::ofstream(folder / "a.json") << R"({"flockstep_scene": 1, "name": "a name that is too long to be kept in place",
      "materials": {"wall": {"base_color": [1, 1, 1]}}, "room": {"min": [0, 0, 0], "max": [9, 9, 9], "material": "wall"},
      "pillars": [{"center": [3, 3], "radius": 1}], "meshes": [{"file": "a.obj", "position": [5, 5, 5]}]})";
  EXPECT_GT(fail_each([&] { World::load(folder / "a.json"); }), 100U);
  EXPECT_GT(fail_each([&] { World::load(folder / "a.obj"); }), 20U);
  std::filesystem::remove_all(folder);
}

void fail_trees() {
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  mesh.triangles = {{0, 1, 2}, {0, 1, 3}};
  const auto kept = make_world({}, {}, mesh);
  prepared(*kept).scene();  // keeps Embree's device alive
  // Embree 3.13 leaks some blocks if memory runs out within rtcCommitScene. If it runs out while a thread joins the scene's
  // allocator, a thread-local pointer dangles. Therefore this test runs in a separate process.
#if defined(__SANITIZE_ADDRESS__)
  const __lsan::ScopedDisabler not_ours;
#endif
  EXPECT_GT(fail_each([&] { prepared(*make_world({}, {}, mesh)).scene(); }, Kept::by_embree), 10U);
  std::_Exit(::testing::Test::HasFailure() ? 1 : 0);
}

TEST_F(AllocationFailure, OfATree) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(fail_trees(), ::testing::ExitedWithCode(0), "");
}

TEST_F(AllocationFailure, OfMakingABatch) {
  EXPECT_GT(fail_each([] { Batch(small_batch(), {closet()}, make_task(NavigationConfig{})); }), 100U);
}

TEST_F(AllocationFailure, OfSnapshotAndRestore) {
  Batch batch(small_batch(), {closet()}, make_task(NavigationConfig{}));
  batch.reset(std::vector<std::uint64_t>{1, 2, 3});
  const std::string first = batch.snapshot();
  batch.step(std::vector<std::int64_t>(3, 0));
  const std::string second = batch.snapshot();
  EXPECT_GT(fail_each([&] { EXPECT_EQ(batch.snapshot(), second); }), 1U);
  const std::uint64_t failed = fail_each([&] {
    const std::string before = batch.snapshot();
    try {
      batch.restore(before == first ? second : first);
    } catch (const std::exception&) {
      EXPECT_EQ(batch.snapshot(), before) << "a refusal changes nothing";
      throw;
    }
  });
  EXPECT_GT(failed, 20U);
  batch.restore(first);
  batch.step(std::vector<std::int64_t>(3, 0));
  EXPECT_EQ(batch.snapshot(), second);
}

}  // namespace
}  // namespace flockstep
