#include "recipe/config_json.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/hash.hpp"
#include "base/json_document.hpp"
#include "flockstep/config.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/tasks.hpp"

namespace flockstep {
namespace {

template <class Config>
std::string config_to_json(const Config& config) {
  return json_of(config).dump();
}

template <class Config>
Config config_from_json(const std::string& text, const std::string& source) {
  Config config;
  read_config(json::Document::parse(text, source)->root().value, "", config);
  config.validate();
  return config;
}

template <class Config>
std::string message_of(const std::string& text) {
  try {
    (void)config_from_json<Config>(text, "recipe.json");
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

// A configuration in which every field differs from its default. The values are written by hand.
BatchConfig unusual() {
  BatchConfig config;
  config.num_envs = 3;
  config.drones_per_env = 2;
  config.num_threads = 5;
  config.block_size = 7;
  config.lidars.push_back({.name = "l", .max_range_m = 0.1F, .azimuth_deg = {0.1F, -359.9F}, .elevation_deg = {-0.0F, 90.0F}});
  config.lidars[0].rate_hz = 125.0F;
  config.cameras.resize(2);
  config.cameras[0].outputs = {.rgb = false, .depth = true, .grey = true};
  config.cameras[0].resize = {320, 17};
  config.cameras[0].pool = Pool::max;
  config.cameras[0].depth_kind = DepthKind::range;
  config.cameras[0].capture_mode = CaptureMode::on_demand;
  config.cameras[1].name = "down";
  config.cameras[1].hfov_deg = 33.3F;
  config.cameras[1].quat_wxyz = {0.7071F, 0.0F, 0.7071F, 0.0F};
  config.cameras[1].samples_per_pixel = 9;
  config.cameras[1].shadows = true;
  config.camera_backend = CameraBackend::automatic;
  config.tracer = TracerKind::embree;
  config.pose_sensor.position_noise_std_m = 1.0F / 3.0F;
  config.imus.push_back({.accelerometer_noise_density = 1e-45F, .offset_m = {0.1F, -0.2F, 3e-8F}});
  config.episode = {.autoreset_mode = AutoresetMode::disabled, .max_episode_steps = 0, .frame_skip = 9, .random_world = true};
  config.clock = {.policy_hz = 50.0F, .physics_hz = 500.0F, .controller_hz = 250.0F};
  config.dynamics.motion = Motion::rotors;
  config.dynamics.control = Control::heading_velocity;
  config.dynamics.wind = {.mean_mps = {1.1F, 2.2F, -3.3F}, .gusts = Gusts::dryden, .height_m = 33.0F};
  config.dynamics.body_drag = false;
  return config;
}

TEST(ConfigJson, IsAnObjectOfTheFields) {
  const std::string text = R"({"position_noise_std_m":0.1,"orientation_noise_std_deg":0.0,"rate_hz":null})";
  EXPECT_EQ(json_of(PoseSensorConfig{.position_noise_std_m = 0.1F}).dump(), text);
  EXPECT_EQ(json_of(ColorRange()).dump(), R"({"space":"excess","low":[0,17,0],"high":[255,255,255]})");
  CameraConfig camera;
  camera.outputs = {.depth = true, .hsv = true};
  EXPECT_EQ(json_of(camera)["outputs"].dump(), R"(["rgb","depth","hsv"])");
}

TEST(ConfigJson, ComesBackAsItWas) {
  const BatchConfig config = unusual();
  const std::string text = config_to_json(config);
  const BatchConfig back = config_from_json<BatchConfig>(text, "x");
  EXPECT_EQ(config_to_json(back), text);
  // A check independent of the text. The hash omits fields that do not affect results.
  Hash hash, hash_back;
  hash.add(config);
  hash_back.add(back);
  EXPECT_EQ(hash.value(), hash_back.value());
  EXPECT_EQ(back.num_threads, 5);
  EXPECT_EQ(back.block_size, 7);
  EXPECT_EQ(back.camera_backend, CameraBackend::automatic);
  EXPECT_EQ(back.cameras[0].capture_mode, CaptureMode::on_demand);
  EXPECT_TRUE(std::signbit(back.lidars[0].elevation_deg[0]));
  EXPECT_EQ(back.imus[0].accelerometer_noise_density, 1e-45F);
}

TEST(ConfigJson, EachDefaultComesBack) {
  const auto comes_back = [](const auto& config) {
    using Config = std::remove_cvref_t<decltype(config)>;
    const std::string text = config_to_json(config);
    EXPECT_EQ(config_to_json(config_from_json<Config>(text, "x")), text);
    EXPECT_EQ(config_to_json(config_from_json<Config>("{}", "x")), config_to_json(Config()));
  };
  comes_back(BatchConfig());
  comes_back(CameraConfig());
  comes_back(ClockConfig());
  comes_back(ColorRange());
  comes_back(DynamicsConfig());
  comes_back(EpisodeConfig());
  comes_back(ImuConfig());
  comes_back(LidarConfig());
  comes_back(NavigationReward());
  comes_back(PoseSensorConfig());
  comes_back(WindConfig());
  comes_back(PlaygroundConfig{.seed = ~std::uint64_t{0}});
  comes_back(ForestConfig());
  comes_back(CityConfig());
  comes_back(OfficeConfig());
  comes_back(WarehouseConfig());
  comes_back(RaceTrackConfig());
  for_each_task([]<class Config>(std::type_identity<Config>) {
    const std::string text = json_of(TaskConfig(Config())).dump();
    EXPECT_EQ(json_of(read_task(nlohmann::json::parse(text))).dump(), text);
    EXPECT_EQ(json_of(read_task({{"name", Config::kName}})).dump(), text);
  });
}

TEST(ConfigJson, EachFloatKeepsItsBits) {
  std::mt19937 random(1);
  NavigationReward reward;
  int compared = 0;
  for (int i = 0; i < 20'000; ++i) {
    const auto value = std::bit_cast<float>(static_cast<std::uint32_t>(random()));
    if (!std::isfinite(value)) continue;
    reward.goal_reward = value;
    const auto back = config_from_json<NavigationReward>(json_of(reward).dump(), "x");
    ASSERT_EQ(std::bit_cast<std::uint32_t>(back.goal_reward), std::bit_cast<std::uint32_t>(value)) << value;
    ++compared;
  }
  EXPECT_GT(compared, 19'000);
}

TEST(ConfigJson, RefusesToWriteNonFiniteNumbers) {
  LidarConfig lidar;
  lidar.offset_m[1] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW((void)json_of(lidar), std::invalid_argument);
  lidar.offset_m[1] = std::numeric_limits<float>::infinity();
  EXPECT_THROW((void)json_of(lidar), std::invalid_argument);
}

TEST(ConfigJson, RefusesInvalidConfigs) {
  const std::vector<std::pair<std::string, std::string>> cases{
      {R"({"episode": {"frame_skp": 2}})",
       "episode.frame_skp: expected one of autoreset_mode, episodes, max_episode_steps, frame_skip, stagger_first_episode, "
       "random_world, "
       "got frame_skp. Did you mean frame_skip?"},
      {R"({"quite_another": 2})",
       "quite_another: expected one of num_envs, drones_per_env, interaction, drone_mesh, num_threads, bl"},
      {R"([])", "configuration: expected an object, got []"},
      {R"({"episode": 3})", "episode: expected an object, got 3"},
      {R"({"episode": null})", "episode: expected an object, got null"},
      {R"({"cameras": {}})", "cameras: expected an array, got {}"},
      {R"({"cameras": [{}, {"width_px": 0}]})", "cameras[1].width_px: expected an integer in [1, 8192], got 0"},
      {R"({"cameras": [{"outputs": ["rgb", "dept"]}]})",
       "cameras[0].outputs[1]: expected one of rgb, depth, semantic, instance, normal, grey, hsv, got dept. Did you mean depth?"},
      {R"({"cameras": [{"outputs": "rgb"}]})", R"(cameras[0].outputs: expected an array of names, got "rgb")"},
      {R"({"cameras": [{"outputs": [1]}]})", "cameras[0].outputs[0]: expected a name, got 1"},
      {R"({"cameras": [{"outputs": []}]})", "camera.outputs: expected at least one of"},
      {R"({"cameras": [{"name": "a/b"}]})", R"(cameras[0].name: expected letters, digits, _ and -, got "a/b")"},
      {R"({"cameras": [{"name": 3}]})", "cameras[0].name: expected a string, got 3"},
      {R"({"cameras": [{"shadows": 1}]})", "cameras[0].shadows: expected true or false, got 1"},
      {R"({"cameras": [{"samples_per_pixel": 5}]})", "cameras[0].samples_per_pixel: expected 1, 4, 9 or 16, got 5"},
      {R"({"cameras": [{"resize": [1, 2, 3]}]})", "cameras[0].resize: expected an array of 2, got [1,2,3]"},
      {R"({"cameras": [{"resize": [1, 2.5]}]})", "cameras[0].resize[1]: expected an integer, got 2.5"},
      {R"({"cameras": [{"depth_kind": "rang"}]})",
       "cameras[0].depth_kind: expected one of planar, range, got rang. Did you mean"},
      {R"({"cameras": [{"depth_kind": 1}]})", "cameras[0].depth_kind: expected a name, got 1"},
      {R"({"cameras": [{}, {}]})", "camera.name: expected a name that no other camera has"},
      {R"({"lidars": [{"offset_m": [0, 0, -101]}]})", "lidars[0].offset_m[2]: expected a number within +-100, got -101"},
      {R"({"lidars": [{"offset_m": [0, "0", 0]}]})", R"(lidars[0].offset_m[1]: expected a number within +-100, got "0")"},
      {R"({"lidars": [{"quat_wxyz": [1, 1, 0, 0]}]})",
       "lidars[0].quat_wxyz: expected a unit quaternion (w, x, y, z), got one of norm"},
      {R"({"lidars": [{"max_range_m": 1e300}]})", "lidars[0].max_range_m: expected a finite number > 0, got 1e+300"},
      {R"({"lidars": [{"max_range_m": 0}]})", "lidars[0].max_range_m: expected a finite number > 0, got 0"},
      {R"({"lidars": [{"azimuth_deg": [0]}]})", "lidar.elevation_deg: expected as many values as azimuth_deg"},
      {R"({"num_envs": -1})", "num_envs: expected an integer in [0, 1048576], got -1"},
      {R"({"num_envs": 1.0})", "num_envs: expected an integer in [0, 1048576], got 1.0"},
      {R"({"num_envs": 1e300})", "num_envs: expected an integer in [0, 1048576], got 1e+300"},
      {R"({"num_envs": true})", "num_envs: expected an integer in [0, 1048576], got true"},
      {R"({"num_envs": 4294967297})", "num_envs: expected an integer from -2147483648 to 2147483647, got 4294967297"},
      {R"({"num_envs": 9223372036854775808})", "num_envs: expected an integer from -2147483648 to 2147483647"},
      {R"({"num_envs": 18446744073709551617})", "num_envs: expected an integer in [0, 1048576], got 1.8446744073709552e+19"},
      {R"({"num_envs": 1, "num_envs": 1})", "recipe.json: expected each field once"},
      {R"({"num_envs": NaN})", "recipe.json: not valid JSON"},
      {R"({"num_envs": 1e999})", "recipe.json: not valid JSON"},
      {R"({"num_envs": 1)", "recipe.json: not valid JSON"},
      {"", "recipe.json: not valid JSON"},
      {std::string(100'000, '['), "recipe.json: expected at most"},
      {R"({"lidars": [{"azimuth_deg": )" + std::string(1, '[') + "0" +
           [] {
             std::string zeros;
             for (int i = 0; i < LidarConfig::kMaxRays; ++i) zeros += ",0";
             return zeros;
           }() +
           "]}]}",
       "lidars[0].azimuth_deg: expected at most 262144 values, got 262145"},
  };
  for (const auto& [text, expected] : cases) {
    const std::string message = message_of<BatchConfig>(text);
    EXPECT_EQ(message.substr(0, expected.size()), expected) << text.substr(0, 100);
  }
  EXPECT_EQ(message_of<PlaygroundConfig>(R"({"seed": -1})"), "seed: expected an integer from 0 to 18446744073709551615, got -1");
  EXPECT_EQ(message_of<PlaygroundConfig>(R"({"size_m": [14, 14, 1]})"), "size_m[2]: expected a number in [1.5, 100], got 1");
  const std::string long_key(1'000'000, 'x');
  EXPECT_LT(message_of<BatchConfig>("{\"" + long_key + "\": 1}").size(), 500U);
}

}  // namespace
}  // namespace flockstep
