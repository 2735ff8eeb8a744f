#include "flockstep/fields.hpp"

#include <set>
#include <type_traits>

#include "base/hash.hpp"
#include "flockstep/array_visitor.hpp"
#include "flockstep/arrays.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/sensors/readings.hpp"
#include "flockstep/state.hpp"
#include "flockstep/tasks.hpp"
#include "standard.hpp"

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

static_assert(has_fields<Weather, 12>());
static_assert(has_fields<Gust, 2>());
static_assert(has_fields<Forgotten, 3>());
static_assert(has_fields<Empty, 0>());
static_assert(lists_every_field<Weather>());
static_assert(lists_every_field<Gust>());
static_assert(lists_every_field<Empty>());
static_assert(!lists_every_field<Forgotten>());

// The engine's own structs.
template <class... T>
consteval bool all_list_every_field() {
  return (lists_every_field<T>() && ...);
}
static_assert(all_list_every_field<BatchConfig, EpisodeConfig, ObservationConfig, ClockConfig, LidarConfig, CameraConfig,
                                   CameraOutputs, PoseSensorConfig, NavigationConfig, NavigationReward>());
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
  BatchConfig config{.num_threads = 3, .block_size = 7, .camera_backend = CameraBackend::gl};
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

using namespace testing;

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
  const std::vector<std::uint8_t> flags{0, 1, 7};
  EXPECT_REFUSED(check_values(std::span(flags), "hit", Values::flag), "snapshot: hit: ... 0 ... 1 ... 7");
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
  collect<BarometerReadings>(all);
  collect<MagnetometerReadings>(all);
  collect<GpsReceiverReadings>(all);
  collect<OpticalFlowReadings>(all);
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
