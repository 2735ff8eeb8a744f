#include "base/check_fields.hpp"

#include <type_traits>

#include "flockstep/config.hpp"
#include "flockstep/tasks.hpp"
#include "standard.hpp"

namespace flockstep {
namespace {

using namespace testing;

struct Leg {
  float length_m = 1.0F;

  static constexpr auto fields() { return field_list(field("length_m", &Leg::length_m, {.limits = above(0)})); }
  void validate() const { check_fields(*this, "leg."); }
};

struct Robot {
  std::string name = "r2";
  std::string motto = "any text/at all";
  int wheels = 4;
  std::uint64_t serial = 7;
  float speed_mps = 1.0F;
  double mass_kg = 1.0;
  float heading_deg = 0.0F;
  std::optional<float> rate_hz;
  std::array<float, 4> quat_wxyz{1, 0, 0, 0};
  std::array<int, 2> size_px{1, 1};
  std::array<float, 2> tray_m{0.5F, 0.5F};
  std::array<std::array<double, 2>, 2> hubs_m{};
  std::vector<float> angles_deg;
  std::vector<Leg> legs{{}, {}};
  std::optional<Leg> tail;
  bool shiny = true;

  static constexpr std::array<Limits, 2> kTray{between(0, 1), between(0.5, 2)};

  static constexpr auto fields() {
    using C = Robot;
    return field_list(
        field("name", &C::name, {.form = Form::plain_name}), field("motto", &C::motto),
        field("wheels", &C::wheels, {.limits = one_of(1, 2, 3, 4)}), field("serial", &C::serial, {.limits = between(1, 1e6)}),
        field("speed_mps", &C::speed_mps, {.limits = above_up_to(0, 2.5)}),
        field("mass_kg", &C::mass_kg, {.limits = at_least(0.1), .alias = "body mass_kg"}), field("heading_deg", &C::heading_deg),
        field("rate_hz", &C::rate_hz, {.limits = above(0)}), field("quat_wxyz", &C::quat_wxyz, {.form = Form::unit_quaternion}),
        field("size_px", &C::size_px, {.limits = between(1, 9)}), field("tray_m", &C::tray_m, {.each = kTray}),
        field("hubs_m", &C::hubs_m, {.limits = within(100)}),
        field("angles_deg", &C::angles_deg, {.limits = between_excluding(-90, 91)}), field("legs", &C::legs),
        field("tail", &C::tail), field("shiny", &C::shiny));
  }
};

TEST(CheckFields, NamesFieldExpectedAndGot) {
  const std::vector<std::pair<std::function<void(Robot&)>, std::string>> cases{
      {[](Robot&) {}, "accepted"},
      {[](Robot& r) { r.name = "r 2"; }, "robot.name: expected letters, digits, _ and -, got \"r 2\""},
      {[](Robot& r) { r.name = ""; }, "robot.name: expected letters, digits, _ and -, got \"\""},
      {[](Robot& r) { r.wheels = 5; }, "robot.wheels: expected 1, 2, 3 or 4, got 5"},
      {[](Robot& r) { r.serial = 0; }, "robot.serial: expected an integer in [1, 1000000], got 0"},
      {[](Robot& r) { r.serial = ~std::uint64_t{0}; },
       "robot.serial: expected an integer in [1, 1000000], got 18446744073709551615"},
      {[](Robot& r) { r.speed_mps = 0; }, "robot.speed_mps: expected a number in (0, 2.5], got 0"},
      {[](Robot& r) { r.speed_mps = std::nextafter(2.5F, 3.0F); }, "robot.speed_mps: expected a number in (0, 2.5], got 2.5"},
      {[](Robot& r) { r.mass_kg = 0.01; }, "robot.body mass_kg: expected a finite number >= 0.1, got 0.01"},
      {[](Robot& r) { r.heading_deg = kNan; }, "robot.heading_deg: expected a finite number, got nan"},
      {[](Robot& r) { r.heading_deg = -std::numeric_limits<float>::infinity(); },
       "robot.heading_deg: expected a finite number, got -inf"},
      {[](Robot& r) { r.rate_hz = -1.0F; }, "robot.rate_hz: expected a finite number > 0, got -1"},
      {[](Robot& r) { r.quat_wxyz = {1, 1, 0, 0}; },
       "robot.quat_wxyz: expected a unit quaternion (w, x, y, z), got one of norm 1.414214"},
      {[](Robot& r) { r.quat_wxyz[2] = kNan; }, "robot.quat_wxyz: expected a unit quaternion (w, x, y, z), got one of norm nan"},
      {[](Robot& r) { r.size_px[1] = 10; }, "robot.size_px[1]: expected an integer in [1, 9], got 10"},
      {[](Robot& r) { r.tray_m[0] = 2; }, "robot.tray_m[0]: expected a number in [0, 1], got 2"},
      {[](Robot& r) { r.tray_m[1] = 0; }, "robot.tray_m[1]: expected a number in [0.5, 2], got 0"},
      {[](Robot& r) { r.hubs_m[1][0] = -101; }, "robot.hubs_m[1][0]: expected a number within +-100, got -101"},
      {[](Robot& r) { r.angles_deg = {0, 0, 91}; }, "robot.angles_deg[2]: expected a number in (-90, 91), got 91"},
      {[](Robot& r) { r.legs[1].length_m = 0; }, "leg.length_m: expected a finite number > 0, got 0"},
      {[](Robot& r) { r.tail = Leg{.length_m = -2}; }, "leg.length_m: expected a finite number > 0, got -2"},
  };
  for (const auto& [change, expected] : cases) {
    Robot robot;
    change(robot);
    EXPECT_EQ(refusal([&] { check_fields(robot, "robot."); }), expected);
  }
}

// -- Each configuration checks each of its fields.

template <class Value>
constexpr bool kIsNumber = std::is_arithmetic_v<Value> && !std::is_same_v<Value, bool>;

// Sets a number, an optional number, or an element of a list. Returns false if the field has no number.
template <class Value>
bool set(Value& value, double number) {
  if constexpr (kIsNumber<Value>) {
    value = static_cast<Value>(number);
    return true;
  } else if constexpr (requires { value.emplace(); } && requires { kIsNumber<typename Value::value_type>; }) {
    if constexpr (kIsNumber<typename Value::value_type>) {
      value = static_cast<typename Value::value_type>(number);
      return true;
    }
  } else if constexpr (requires { value.begin(); } && !std::is_same_v<Value, std::string>) {
    if constexpr (requires { value.resize(1); }) value.resize(1);
    return set(value[0], number);
  }
  return false;
}

template <class Config>
int count_refused(const std::string& prefix) {
  int refused = 0;
  const Config defaults;
  for_each_field(defaults, [&](const auto& field, const auto&) {
    const Limits& limits = field.info.limits;
    const std::string name = prefix + (field.info.alias == nullptr ? field.name : field.info.alias);
    for (const double beyond : {limits.least - (limits.excludes_least ? 0.0 : 1.0), limits.greatest + 1.0}) {
      if (!std::isfinite(beyond) || limits.num_choices > 0) continue;
      Config config;
      if (!set(config.*(field.member), beyond)) continue;
      const std::string message = refusal([&] { config.validate(); });
      EXPECT_EQ(message.substr(0, name.size()), name) << beyond << ": " << message;
      ++refused;
    }
  });
  return refused;
}

TEST(CheckFields, IsCalledByEachConfiguration) {
  EXPECT_EQ(count_refused<LidarConfig>("lidar."), 30);
  EXPECT_EQ(count_refused<CameraConfig>("camera."), 32);
  EXPECT_EQ(count_refused<DepthErrors>("camera.depth_errors."), 21);
  EXPECT_EQ(count_refused<ColorErrors>("camera.color_errors."), 12);
  EXPECT_EQ(count_refused<CameraConfig>("camera."), 32);
  EXPECT_EQ(count_refused<EventPixels>("camera.event_pixels."), 10);
  EXPECT_EQ(count_refused<ColorRange>("color."), 4);
  EXPECT_EQ(count_refused<PoseSensorConfig>("pose_sensor."), 19);
  EXPECT_EQ(count_refused<ImuConfig>("imu."), 29);
  EXPECT_EQ(count_refused<BarometerConfig>("barometer."), 17);
  EXPECT_EQ(count_refused<MagnetometerConfig>("magnetometer."), 15);
  EXPECT_EQ(count_refused<GpsReceiverConfig>("gps_receiver."), 21);
  EXPECT_EQ(count_refused<OpticalFlowConfig>("optical_flow."), 13);
  EXPECT_EQ(count_refused<EpisodeConfig>(""), 3);
  EXPECT_EQ(count_refused<ClockConfig>(""), 4);
  EXPECT_EQ(count_refused<ObservationConfig>("observed."), 8);
  EXPECT_EQ(count_refused<WindConfig>("wind."), 9);
  EXPECT_EQ(count_refused<DynamicsConfig>(""), 10);
  EXPECT_EQ(count_refused<NavigationReward>("reward."), 4);
  EXPECT_EQ(count_refused<NavigationConfig>("task."), 3);
  EXPECT_EQ(count_refused<HoverConfig>("task."), 12);
  EXPECT_EQ(count_refused<TrackConfig>("task."), 11);
  EXPECT_EQ(count_refused<GateDetector>("task.gate_detector."), 14);
}

TEST(CheckFields, IsDoneToTheConfigurationsOfABatch) {
  BatchConfig config;
  config.cameras.resize(1);
  config.cameras[0].width_px = 0;
  EXPECT_EQ(refusal([&] { config.validate(); }), "camera.width_px: expected an integer in [1, 8192], got 0");
  config.cameras.clear();
  config.num_threads = 5000;
  EXPECT_EQ(refusal([&] { config.validate(); }), "num_threads: expected an integer in [0, 4096], got 5000");
  config.num_threads = 0;
  config.dynamics.wind.height_m = 2.0F;
  EXPECT_EQ(refusal([&] { config.validate(); }), "wind.height_m: expected a number in [3, 300], got 2");
}

}  // namespace
}  // namespace flockstep
