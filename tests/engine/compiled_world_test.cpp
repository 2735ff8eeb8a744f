#include "compiled/compiled_world.hpp"

#include <gtest/gtest.h>

#include <memory>
#include <stdexcept>
#include <thread>
#include <vector>

#include "batch_helpers.hpp"
#include "collision/obstacles.hpp"
#include "render/shading.hpp"
#include "trace/scene.hpp"

namespace flockstep {
namespace {

using testing::closet;

TEST(CompiledWorld, EachPartIsBuiltOnceWhicheverThreadComesFirst) {
  struct Seen {
    const CompiledWorld* world;
    const trace::Scene* scene;
    const collision::Obstacles* obstacles;
    const render::Shading* shading;
    bool operator==(const Seen&) const = default;
  };
  const auto world = closet();
  const auto look = [&world] {
    const CompiledWorld& all = compiled(*world);
    return Seen{&all, &all.scene(), &all.obstacles(), &all.shading()};
  };
  std::vector<Seen> seen(8);
  std::vector<std::thread> threads;
  for (Seen& slot : seen) threads.emplace_back([&look, &slot] { slot = look(); });
  for (std::thread& thread : threads) thread.join();
  for (const Seen& slot : seen) EXPECT_EQ(slot, look());
  EXPECT_EQ(&compiled(*world).world(), world.get());
}

TEST(CompiledWorld, IsOfItsWorldAlone) {
  const auto one = closet();
  const auto other = closet();
  EXPECT_NE(&compiled(*one), &compiled(*other));
}

TEST(Attachment, GoesWithItsOwner) {
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

TEST(Attachment, IsMadeByTheNextWhereMakingFails) {
  const Attachment attachment;
  const auto fail = []() -> std::shared_ptr<const int> { throw std::runtime_error("no"); };
  EXPECT_THROW(attachment.get<int>(fail), std::runtime_error);
  EXPECT_EQ(attachment.get<int>([] { return std::make_shared<const int>(3); }), 3);
  EXPECT_EQ(attachment.get<int>(fail), 3) << "made once";
}

}  // namespace
}  // namespace flockstep
