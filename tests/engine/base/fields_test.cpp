#include "flockstep/fields.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/hash.hpp"
#include "flockstep/array_visitor.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/tasks.hpp"

namespace flockstep {
namespace {

enum class Mood : std::uint8_t { calm, wild };

struct Gust {
  float speed_mps = 1.0F;
  int seed = 3;

  static constexpr auto fields() { return field_list(field("speed_mps", &Gust::speed_mps), field("seed", &Gust::seed)); }
};

// A struct with every kind of field that configurations have.
struct Weather {
  bool rain = false;
  int drops = 4;
  float hail_mm = 0.5F;
  std::optional<float> fog_m;
  std::string name = "fair";
  std::vector<float> layers{1.0F, 2.0F};
  std::array<float, 3> wind{1.0F, 0.0F, 0.0F};
  Mood mood = Mood::calm;
  Gust gust;
  std::vector<Gust> gusts{{}, {}};
  std::optional<Gust> squall;
  int threads = 1;

  static constexpr auto fields() {
    using C = Weather;
    return field_list(field("rain", &C::rain), field("drops", &C::drops), field("hail_mm", &C::hail_mm),
                      field("fog_m", &C::fog_m), field("name", &C::name), field("layers", &C::layers), field("wind", &C::wind),
                      field("mood", &C::mood), field("gust", &C::gust), field("gusts", &C::gusts), field("squall", &C::squall),
                      field("threads", &C::threads, {.affects_hash = AffectsHash::no}));
  }
};

// A struct with a member that its field list lacks.
struct Forgotten {
  float speed_mps = 1.0F;
  int seed = 3;
  std::array<float, 3> added{};

  static constexpr auto fields() {
    return field_list(field("speed_mps", &Forgotten::speed_mps), field("seed", &Forgotten::seed));
  }
};

struct Empty {
  static constexpr auto fields() { return field_list(); }
};

static_assert(count_fields<Weather>() == 12);
static_assert(count_fields<Gust>() == 2);
static_assert(count_fields<Forgotten>() == 3);
static_assert(count_fields<Empty>() == 0);
static_assert(lists_every_field<Weather>());
static_assert(lists_every_field<Gust>());
static_assert(lists_every_field<Empty>());
static_assert(!lists_every_field<Forgotten>());

// The engine's own structs.
template <class... T>
consteval bool all_list_every_field() {
  return (lists_every_field<T>() && ...);
}
static_assert(all_list_every_field<BatchConfig, EpisodeConfig, ClockConfig, LidarConfig, CameraConfig, CameraOutputs,
                                   PoseSensorConfig, NavigationConfig, NavigationReward>());
static_assert(all_list_every_field<State, ContactState, EpisodeState, Outputs>());

TEST(Fields, AreVisitedInTheirOrder) {
  const Weather weather;
  std::vector<std::string> names;
  for_each_field(weather, [&](const auto& field, const auto&) { names.emplace_back(field.name); });
  EXPECT_EQ(names, (std::vector<std::string>{"rain", "drops", "hail_mm", "fog_m", "name", "layers", "wind", "mood", "gust",
                                             "gusts", "squall", "threads"}));
}

TEST(Fields, CanBeWritten) {
  Gust gust;
  for_each_field(gust, [](const auto& field, auto& value) {
    value = 7;
    EXPECT_EQ(field.info.affects_hash, AffectsHash::yes);
  });
  EXPECT_EQ(gust.speed_mps, 7.0F);
  EXPECT_EQ(gust.seed, 7);
}

template <class T>
std::uint64_t hash_of(const T& value) {
  Hash hash;
  hash.add(value);
  return hash.value();
}

TEST(Fields, TheHashChangesWithRelevantFields) {
  const std::vector<std::function<void(Weather&)>> changes{
      [](Weather& w) { w.rain = true; },           [](Weather& w) { w.drops = 5; },
      [](Weather& w) { w.hail_mm = 0.25F; },       [](Weather& w) { w.hail_mm = -0.5F; },
      [](Weather& w) { w.fog_m = 0.0F; },          [](Weather& w) { w.fog_m = 1.0F; },
      [](Weather& w) { w.name = "fail"; },         [](Weather& w) { w.name = ""; },
      [](Weather& w) { w.layers = {2.0F, 1.0F}; }, [](Weather& w) { w.layers = {1.0F, 2.0F, 0.0F}; },
      [](Weather& w) { w.layers.clear(); },        [](Weather& w) { w.wind = {0.0F, 1.0F, 0.0F}; },
      [](Weather& w) { w.mood = Mood::wild; },     [](Weather& w) { w.gust.seed = 4; },
      [](Weather& w) { w.gust.speed_mps = 2.0F; }, [](Weather& w) { w.gusts[1].seed = 4; },
      [](Weather& w) { w.gusts[0].seed = 4; },     [](Weather& w) { w.gusts.pop_back(); },
      [](Weather& w) { w.squall.emplace(); },      [](Weather& w) { w.squall.emplace().seed = 4; },
  };
  std::vector<std::uint64_t> hashes{hash_of(Weather())};
  for (const auto& change : changes) {
    Weather weather;
    change(weather);
    hashes.push_back(hash_of(weather));
    EXPECT_EQ(hash_of(weather), hashes.back());
  }
  std::sort(hashes.begin(), hashes.end());
  EXPECT_EQ(std::unique(hashes.begin(), hashes.end()), hashes.end()) << "two of them have the same hash";
}

TEST(Fields, TheHashIgnoresIrrelevantFields) {
  Weather weather;
  weather.threads = 8;
  EXPECT_EQ(hash_of(weather), hash_of(Weather()));
  BatchConfig config;
  config.num_threads = 3;
  config.block_size = 7;
  config.camera_backend = CameraBackend::gl;
  EXPECT_EQ(hash_of(config), hash_of(BatchConfig()));
  CameraConfig camera;
  camera.capture_mode = CaptureMode::on_demand;
  EXPECT_EQ(hash_of(camera), hash_of(CameraConfig()));
}

// -- Arrays.

struct Half {
  std::vector<std::int32_t> count;

  static constexpr auto fields() { return field_list(field("count", &Half::count)); }
};

struct Arrays {
  std::vector<float> place;
  Half half;
  std::vector<std::uint8_t> flag;
  std::vector<std::array<float, 2>> pairs;
  std::vector<Buffer> seen;
  std::vector<double> sum;

  static constexpr auto fields() {
    using C = Arrays;
    return field_list(field("place", &C::place), field("half", &C::half), field("flag", &C::flag), field("pairs", &C::pairs),
                      field("seen", &C::seen), field("sum", &C::sum));
  }
};

class Noted final : public ArrayVisitor {
 public:
  struct Array {
    std::string name;
    std::size_t bytes;
    std::optional<DType> type;
    bool operator==(const Array&) const = default;
  };
  void bytes(std::string_view name, std::span<std::byte> bytes, std::optional<DType> type) override {
    arrays.push_back({std::string(name), bytes.size(), type});
    std::fill(bytes.begin(), bytes.end(), std::byte{1});
  }
  void blob(std::string_view name, std::string& bytes) override { arrays.push_back({std::string(name), bytes.size(), {}}); }

  std::vector<Array> arrays;
};

TEST(Fields, AnArrayVisitorIsShownEachArray) {
  Arrays arrays{.place = std::vector<float>(6), .half = {std::vector<std::int32_t>(2)}, .flag = {0, 0, 0}, .pairs = {{}, {}}};
  arrays.seen.emplace_back(Field{.name = "image", .type = DType::uint8, .shape = {5}}, 2);
  arrays.seen.emplace_back(Field{.name = "ranges", .shape = {3, 2}}, 2);
  arrays.sum.resize(4);
  Noted noted;
  noted.fields(arrays);
  const std::vector<Noted::Array> expected{
      {"place", 24, DType::float32}, {"count", 8, DType::int32},   {"flag", 3, DType::uint8},  {"pairs", 16, std::nullopt},
      {"seen", 10, DType::uint8},    {"seen", 48, DType::float32}, {"sum", 32, DType::float64}};
  EXPECT_EQ(noted.arrays, expected);
  // The visited arrays are the originals, not copies.
  EXPECT_EQ(arrays.half.count, std::vector<std::int32_t>(2, 0x01010101));
  EXPECT_EQ(arrays.seen[0].row<std::uint8_t>(1)[4], 1);
}

}  // namespace
}  // namespace flockstep
