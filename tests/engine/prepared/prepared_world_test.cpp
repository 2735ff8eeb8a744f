#include "prepared/prepared_world.hpp"

#include <memory_resource>

#include "base/near_memory.hpp"
#include "batch_helpers.hpp"
#include "collision/obstacles.hpp"
#include "flockstep/generators.hpp"
#include "render/raycast/shading.hpp"
#include "trace/scene.hpp"

namespace flockstep {
namespace {

using namespace testing;

// The data that a step reads should lie in few memory pages. This fails if a class grows too much.
TEST(PreparedWorld, SceneAndObstaclesOfAPlaygroundLieSideBySide) {
  const auto world = flockstep::playground({});
  const PreparedWorld& all = prepared(*world);
  const auto* const scene = reinterpret_cast<const std::byte*>(&all.scene());
  const auto* const shape = reinterpret_cast<const std::byte*>(&all.scene().shape(0));
  const auto* const obstacles = reinterpret_cast<const std::byte*>(&all.obstacles());
  const auto* const room = reinterpret_cast<const std::byte*>(all.obstacles().rooms().data());
  for (const std::byte* const part : {shape, obstacles, room}) {
    EXPECT_GT(part - scene, 0);
    EXPECT_LT(part - scene, 4096);
  }
}

TEST(NearMemory, ObjectsThatDoNotFitGoToTheHeap) {
  NearMemory memory;
  std::pmr::vector<double> fits(16, 1.0, &memory);
  std::pmr::vector<double> another(16, 2.0, &memory);
  EXPECT_EQ(another.data(), fits.data() + 16);
  std::pmr::vector<double> large(4096, 3.0, &memory);
  const auto* const begin = reinterpret_cast<const std::byte*>(&memory);
  const auto* const outside = reinterpret_cast<const std::byte*>(large.data());
  EXPECT_TRUE(outside < begin || outside >= begin + sizeof(memory));
  struct alignas(64) Line {
    int number;
  };
  const std::pmr::vector<char> byte(1, 'a', &memory);
  const std::pmr::vector<Line> aligned(2, Line{4}, &memory);  // sanitizers check the alignment
  EXPECT_EQ(aligned[1].number, 4);
  EXPECT_EQ(fits[15] + another[15] + large[4095], 6.0);
}

TEST(NearMemory, AnObjectThatThrowsLeavesNothing) {
  struct Throws {
    explicit Throws(std::pmr::memory_resource& memory) : numbers(10'000, 0, &memory) { throw std::runtime_error("no"); }
    std::pmr::vector<int> numbers;
  };
  NearMemory memory;
  EXPECT_THROW(static_cast<void>(make_near<Throws>(memory)), std::runtime_error);
}

TEST(PreparedWorld, EachPartIsBuiltOnceByAnyThread) {
  struct Seen {
    const PreparedWorld* world;
    const trace::Scene* scene;
    const collision::Obstacles* obstacles;
    const render::Shading* shading;
    bool operator==(const Seen&) const = default;
  };
  const auto world = closet();
  const auto look = [&world] {
    const PreparedWorld& all = prepared(*world);
    return Seen{&all, &all.scene(), &all.obstacles(), &all.shading()};
  };
  std::vector<Seen> seen(8);
  std::vector<std::thread> threads;
  for (Seen& slot : seen) threads.emplace_back([&look, &slot] { slot = look(); });
  for (std::thread& thread : threads) thread.join();
  for (const Seen& slot : seen) EXPECT_EQ(slot, look());
  EXPECT_EQ(&prepared(*world).world(), world.get());
}

TEST(PreparedWorld, IsOfItsWorldAlone) {
  const auto one = closet();
  const auto other = closet();
  EXPECT_NE(&prepared(*one), &prepared(*other));
}

TEST(Attachment, IsDestroyedWithItsOwner) {
  std::weak_ptr<const int> seen;
  {
    const Attachment attachment;
    const auto make = [&seen] {
      auto made = std::make_shared<const int>(7);
      seen = made;
      return made;
    };
    EXPECT_EQ(attachment.get<int>(make), 7);
    EXPECT_FALSE(seen.expired());
  }
  EXPECT_TRUE(seen.expired());
}

TEST(Attachment, IsMadeByTheNextCallAfterAFailure) {
  const Attachment attachment;
  const auto fail = []() -> std::shared_ptr<const int> { throw std::runtime_error("no"); };
  EXPECT_THROW(attachment.get<int>(fail), std::runtime_error);
  EXPECT_EQ(attachment.get<int>([] { return std::make_shared<const int>(3); }), 3);
  EXPECT_EQ(attachment.get<int>(fail), 3) << "made once";
}

}  // namespace
}  // namespace flockstep
