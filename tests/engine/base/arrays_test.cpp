#include "flockstep/arrays.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "flockstep/batch.hpp"
#include "flockstep/readings.hpp"
#include "flockstep/state.hpp"

namespace flockstep {
namespace {

struct Sample {
  std::vector<float> position;
  std::vector<double> terms;
  std::vector<float> ranges;
  std::vector<std::uint8_t> image;
  int other = 0;

  static constexpr auto fields() {
    using C = Sample;
    return field_list(array("position", &C::position, {.columns = 3, .unit = "m"}),
                      array("terms", &C::terms, {.rows = Rows::task, .per = Per::term}),
                      array("ranges", &C::ranges, {.per = Per::ray, .values = Values::range}),
                      array("image", &C::image, {.rows = Rows::env, .per = Per::pixel, .columns = 3, .values = Values::any}),
                      field("other", &C::other));
  }
};

constexpr ArraySizes kSizes{.num_envs = 2, .num_drones = 6, .num_task_rows = 2, .num_terms = 5, .num_rays = 7, .num_pixels = 12};

TEST(Arrays, AreAllocatedAsTheirListSays) {
  Sample sample;
  allocate(sample, kSizes);
  EXPECT_EQ(sample.position.size(), 6U * 3);
  EXPECT_EQ(sample.terms.size(), 2U * 5);
  EXPECT_EQ(sample.ranges.size(), 6U * 7);
  EXPECT_EQ(sample.image.size(), 2U * 12 * 3);
  EXPECT_EQ(sample.position[0], 0.0F);
  EXPECT_EQ(sample.ranges[41], std::numeric_limits<float>::infinity());
}

TEST(Arrays, AreViewedWithTheirTypeAndSize) {
  Sample sample;
  allocate(sample, kSizes);
  std::string seen;
  for_each_view(sample, {}, [&](const ArrayView& view) {
    seen += std::string(view.name) + ' ' + view.kind + std::to_string(view.value_size) + ' ' + std::to_string(view.size) + ';';
  });
  EXPECT_EQ(seen, "position f4 18;terms f8 10;ranges f4 42;image u1 72;");
}

// Checks values next to each limit, accepted and refused.
template <class T>
void expect_limits(Values allowed, const std::vector<T>& good, const std::vector<T>& bad) {
  for (const T value : good) EXPECT_NO_THROW(check_values(std::span(&value, 1), "a", allowed)) << +value;
  for (const T value : bad) EXPECT_THROW(check_values(std::span(&value, 1), "a", allowed), std::invalid_argument) << +value;
}

TEST(Arrays, RefuseValuesThatTheirListDoesNotAllow) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const float nan = std::nanf("");
  constexpr std::int64_t kMax = std::int64_t{1} << 62;
  expect_limits<float>(Values::any, {nan, kInfinity, -kInfinity}, {});
  expect_limits<float>(Values::finite, {0.0F, -3e38F, 1e-45F}, {nan, kInfinity, -kInfinity});
  expect_limits<double>(Values::finite, {1e300, -1e300}, {std::nan(""), -std::numeric_limits<double>::infinity()});
  expect_limits<std::uint8_t>(Values::flag, {0, 1}, {2, 255});
  expect_limits<std::int64_t>(Values::count, {0, kMax}, {-1, kMax + 1});
  expect_limits<std::int64_t>(Values::last_count, {-1, kMax}, {-2, kMax + 1});
  expect_limits<float>(Values::fraction, {0.0F, 1.0F}, {std::nextafter(0.0F, -1.0F), std::nextafter(1.0F, 2.0F), nan});
  expect_limits<float>(Values::range, {0.0F, kInfinity}, {-1e-45F, nan});
  try {
    const std::vector<std::uint8_t> flags{0, 1, 7};
    check_values(std::span(flags), "hit", Values::flag);
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "snapshot: hit: expected 0 or 1, got 7");
  }
}

template <class T>
void collect(std::vector<ArrayView>& all) {
  for_each_view(T{}, {}, [&](const ArrayView& view) { all.push_back(view); });
}

TEST(Arrays, OfABatchHaveDifferentNamesAndSayWhoWritesThem) {
  std::vector<ArrayView> all;
  collect<State>(all);
  collect<FlightState>(all);
  collect<EpisodeState>(all);
  collect<Outputs>(all);
  collect<PoseReadings>(all);
  collect<ImuReadings>(all);
  std::set<std::string> names;
  for (const ArrayView& view : all) EXPECT_TRUE(names.insert(view.name).second) << view.name;
  collect<ContactState>(all);
  collect<LidarReadings>(all);
  collect<CameraImages>(all);
  for (const ArrayView& view : all) {
    EXPECT_STRNE(view.info.writer, "") << view.name;
    EXPECT_STRNE(view.info.about, "") << view.name;
  }
  EXPECT_GT(all.size(), 50U);
}

}  // namespace
}  // namespace flockstep
