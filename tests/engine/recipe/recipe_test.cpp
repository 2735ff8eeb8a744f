#include "flockstep/recipe.hpp"

#include <bit>
#include <nlohmann/json.hpp>
#include <random>
#include <type_traits>

#include "base/hash.hpp"
#include "base/json_document.hpp"
#include "batch_helpers.hpp"
#include "flockstep/config.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/scenes.hpp"
#include "recipe/config_json.hpp"

namespace flockstep {
namespace {

using namespace testing;

const RecipeAccess kBundled{.scenes = FLOCKSTEP_SCENES};

std::string refusal_of(const std::string& json) {
  return refusal([&] { Recipe::from_json(json); });
}

std::string refusal_of(const Recipe& recipe, const RecipeAccess& access = kBundled) {
  return refusal([&] { make_batch(recipe, access); });
}

void expect_has(const std::string& text, const std::string& part) { EXPECT_TRUE(names(text, part)); }

// Returns the rewards, ends and poses of some steps as bytes.
std::string flown(Batch& batch) {
  std::string bytes;
  const auto add = [&](const auto& values) {
    bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(values[0]));
  };
  batch.reset(std::vector<std::uint64_t>(static_cast<std::size_t>(batch.config().num_envs), 7));
  const auto drones = static_cast<std::size_t>(batch.config().num_drones());
  const Field& action = batch.task()->spec().action;
  for (int step = 0; step < 40; ++step) {
    if (is_floating(action.type)) {
      std::vector<float> actions(drones * action.size());
      for (std::size_t i = 0; i < actions.size(); ++i)
        actions[i] = 0.1F * static_cast<float>((i + static_cast<std::size_t>(step)) % 7) - 0.3F;
      batch.step(std::span<const float>(actions));
    } else {
      std::vector<std::int64_t> actions(drones);
      for (std::size_t i = 0; i < drones; ++i) actions[i] = (static_cast<std::int64_t>(i) + step) % 6;
      batch.step(std::span<const std::int64_t>(actions));
    }
    add(batch.outputs().reward);
    add(batch.outputs().episode_end);
    add(batch.state().position);
    for (const Buffer& buffer : batch.outputs().observation) add(buffer.bytes());
  }
  return bytes;
}

TEST(Recipe, HasTheDefaultsOfItsTask) {
  const Recipe hover = Recipe::from_json(R"({"task": {"name": "hover"}})");
  const TaskDefaults defaults = make_task(HoverConfig{})->defaults();
  EXPECT_EQ(hover.worlds, std::vector<std::string>{defaults.worlds});
  EXPECT_EQ(std::get<std::string>(hover.drone), defaults.drone);
  EXPECT_EQ(hover.batch.dynamics.motion, defaults.batch.dynamics.motion);
  EXPECT_EQ(hover.batch.clock.policy_hz, defaults.batch.clock.policy_hz);
  const Recipe swap = Recipe::from_json(R"({"task": {"name": "swap"}})");
  EXPECT_EQ(swap.batch.drones_per_env, make_task(SwapConfig{})->defaults().batch.drones_per_env);
  EXPECT_EQ(swap.batch.interaction, Interaction::collide);
  const Recipe pixels = Recipe::from_json(R"({"task": {"name": "navigation", "observation": "pixels"}})");
  EXPECT_EQ(pixels.worlds, std::vector<std::string>{"camera-train"});
  EXPECT_EQ(pixels.batch.cameras.size(), 1U);
  EXPECT_EQ(std::get<NavigationConfig>(pixels.task).action, NavigationConfig::observing(ObservationKind::pixels).action);
}

TEST(Recipe, TakesEveryFieldOfABatchThatATaskSets) {
  Recipe recipe = Recipe::for_task(RegisteredTask{"mine/Reach-v0"});
  recipe.take({.worlds = "validation", .drone = "x500", .batch = {.num_threads = 3, .max_bodies = 5}});
  EXPECT_EQ(recipe.worlds, std::vector<std::string>{"validation"});
  EXPECT_EQ(std::get<std::string>(recipe.drone), "x500");
  EXPECT_EQ(recipe.batch.num_threads, 3);
  EXPECT_EQ(recipe.batch.max_bodies, 5);
}

TEST(Recipe, ReadsBackEqual) {
  Recipe navigation = Recipe::for_task(NavigationConfig{.step_m = 0.123F});
  navigation.batch.num_envs = 3;
  navigation.batch.drones_per_env = 2;
  navigation.batch.lidars.push_back({.name = "up", .channels = 3, .beams = 7, .vfov_deg = 12.5F});
  navigation.batch.cameras = {{.name = "front", .width_px = 32, .height_px = 24, .hfov_deg = 77.7F}};
  navigation.batch.clock.policy_hz = 1.0F / 3.0F;
  navigation.batch.episode.max_episode_steps = 17;
  navigation.worlds = {"validation", "forest/seed-0..2"};
  Recipe track = Recipe::for_task(TrackConfig{});
  track.drone = DroneModel::load("kingfisher").scaled(1.5, 2.0);
  for (const Recipe& recipe : {navigation, track, Recipe::for_task(HoverConfig{}), Recipe::for_task({}),
                               Recipe::for_task(RegisteredTask{"mine/Reach-v0"})}) {
    const std::string json = recipe.to_json();
    EXPECT_EQ(Recipe::from_json(json).to_json(), json);
  }
}

TEST(Recipe, BuildsTheBatchThatItsFieldsBuildByHand) {
  const std::string json = R"({"task": {"name": "navigation", "step_m": 0.2}, "worlds": ["validation"], "num_envs": 5,
                               "num_threads": 1, "pose_sensor": {"position_noise_std_m": 0.01},
                               "episode": {"autoreset_mode": "same_step", "max_episode_steps": 11}})";
  const auto from_recipe = make_batch(Recipe::from_json(json), kBundled);
  BatchConfig config = lidar_batch(5);
  config.pose_sensor.position_noise_std_m = 0.01F;
  config.episode = {.autoreset_mode = AutoresetMode::same_step, .max_episode_steps = 11};
  Batch by_hand(config, {playground("validation-1"), playground("validation-2")}, make_task(NavigationConfig{.step_m = 0.2F}));
  const std::string bytes = flown(*from_recipe);
  EXPECT_TRUE(bytes == flown(by_hand));
  EXPECT_GT(bytes.size(), 1000U);
}

TEST(Recipe, BuildsFlightsTheSameFromItsJson) {
  Recipe recipe = Recipe::for_task(TrackConfig{});
  recipe.batch.num_envs = 3;
  recipe.batch.drones_per_env = 2;
  recipe.batch.num_threads = 1;
  recipe.batch.imus = {{.name = "a", .gyroscope_noise_density = 0.01F}, {.name = "b"}};
  const auto direct = make_batch(recipe, kBundled), read = make_batch(Recipe::from_json(recipe.to_json()), kBundled);
  EXPECT_TRUE(flown(*direct) == flown(*read));
}

TEST(Recipe, RefusesATaskOfAnotherProgram) {
  const Recipe recipe = Recipe::from_json(R"({"task": {"name": "mine/ReachHeight-v0"}, "worlds": ["train"]})");
  expect_has(refusal_of(recipe), R"(task.name: ... "navigation" ... "hover" ... "track" ... "race" ... "mine/ReachHeight-v0")");
  expect_has(refusal_of(recipe), "only the program that registered a task under this id can make it");
}

TEST(Recipe, NamesThePlaceOfAMistakeAndTheNearestName) {
  for (const auto& [json, place, hint] :
       {std::array{R"({"taks": null})", "recipe: ", "Did you mean task?"},
        {R"({"episode": {"frame_skp": 2}})", "episode.", "Did you mean frame_skip?"},
        {R"({"lidars": [{"beems": 2}]})", "lidars[0].", "Did you mean beams?"},
        {R"({"task": {"name": "hoover"}})", "task.name: ", "Did you mean hover?"},
        {R"({"task": {"name": "hover", "spin_wieght": 1}})", "task.spin", "Did you mean spin_weight?"},
        {R"({"dynamics": {"motion": "rotor"}})", "dynamics.motion: ", "Did you mean rotors?"}}) {
    expect_has(refusal_of(json), std::string(place) + " ... " + hint);
  }
  expect_has(refusal_of(R"({"num_envs": 1e300})"), "num_envs");
  expect_has(refusal_of(R"({"num_envs": -1})"), "num_envs");
  expect_has(refusal_of(R"({"worlds": "train"})"), "worlds: ... array");
  expect_has(refusal_of(R"({"worlds": [1]})"), "worlds: ... array");
  expect_has(refusal_of(R"({"drone": 5})"), "drone: ... object");
  expect_has(refusal_of(R"([])"), "recipe: expected an object");
  expect_has(refusal_of(R"({"task": "hover"})"), "task: ... object");
}

TEST(Recipe, OpensNoFilesUnlessTheCallerAllowsIt) {
  const std::filesystem::path scenes = FLOCKSTEP_SCENES;
  const std::string bundled = (scenes / "playground" / "train-1.json").string();
  Recipe recipe = Recipe::for_task(NavigationConfig{});
  recipe.batch.num_threads = 1;
  for (const std::string& path :
       {std::string("/etc/hosts.json"), std::string("hall.json"), (scenes / ".." / "hall.json").string(),
        (scenes / "playground" / ".." / ".." / "drones" / "t650.json").string(), std::string("/etc/PASSWD.GLB")}) {
    recipe.worlds = {path};
    expect_has(refusal_of(recipe), "worlds: this recipe may only use bundled scenes and drones");
    recipe.worlds = {"train"};
    recipe.drone = path;
    if (path.ends_with(".json")) expect_has(refusal_of(recipe), "drone: this recipe may only use bundled scenes and drones");
    recipe.drone = std::string();
  }
  recipe.worlds = {std::string(100'000, 'x') + ".json"};
  expect_has(refusal_of(recipe), "worlds: this recipe may only use bundled scenes and drones");
  recipe.worlds = {bundled};
  EXPECT_EQ(refusal_of(recipe), "accepted");
  EXPECT_NE(refusal_of(recipe, {}), "accepted") << "no folder is known";
  EXPECT_EQ(refusal_of(recipe, {.allows_files = true}), "accepted");
  for (const char* const path : {"/etc/passwd", "../passwd"}) {
    recipe.worlds = {path};
    expect_has(refusal_of(recipe), "worlds: this recipe may only use bundled scenes and drones");
  }
  recipe.worlds = {"playground/../../etc"};
  expect_has(refusal_of(recipe), "worlds: unknown scene 'playground/../../etc'");
}

TEST(Recipe, BuildsALimitedNumberOfWorlds) {
  Recipe recipe;
  for (const auto& [worlds, most] : {std::pair(std::vector<std::string>{"train", "forest/seed-0..99999"}, 10'000U),
                                     {{"playground/seed-0..10000"}, 10'000U},
                                     {{"city/seed-0..100"}, 10'000U},
                                     {{"train", "forest/seed-7"}, 34U},
                                     {{"bench/simple", "bench/simple", "bench/simple"}, 2U}}) {
    recipe.worlds = worlds;
    expect_has(refusal_of(recipe, {.scenes = FLOCKSTEP_SCENES, .max_worlds = most}),
               "worlds: ... " + std::to_string(most) + " ... (max_worlds)");
  }
  recipe.worlds = {"bench/simple", "bench/simple", "playground/seed-1..2"};
  EXPECT_EQ(refusal_of(recipe, {.max_worlds = 4}), "accepted");
  EXPECT_EQ(cost_of_scenes({"forest/seed-1", "forest/seed-1", "forest/seed-0..1"}, 1000), 62U);
}

TEST(Recipe, NamesItsFormatAndRefusesAnother) {
  expect_has(Recipe::for_task(HoverConfig{}).to_json(), "\"flockstep_recipe\": 1");
  EXPECT_EQ(refusal_of(R"({"flockstep_recipe": 1, "task": {"name": "hover"}})"), "accepted");
  EXPECT_TRUE(names(refusal_of(R"({"flockstep_recipe": 2, "fog": {}})"), "recipe: /flockstep_recipe: ... 1 ... 2"));
}

TEST(Recipe, SurvivesAnyText) {
  Recipe recipe = Recipe::for_task(NavigationConfig{});
  recipe.batch.cameras = {{.name = "front"}};
  const std::string sound = recipe.to_json();
  Random random(5);
  auto& numbers = random.generator();
  int refused = 0;
  for (int i = 0; i < 3000; ++i) {
    std::string text = sound;
    for (int changes = 0; changes < 1 + i % 4; ++changes) {
      const std::size_t at = numbers() % text.size();
      if (i % 3 == 0) text.erase(at, numbers() % 20);
      if (i % 3 == 1) text.insert(at, text.substr(numbers() % text.size(), numbers() % 20));
      if (i % 3 == 2) text[at] = static_cast<char>(numbers() % 256);
    }
    refused += refusal_of(text) != "accepted";
  }
  EXPECT_GT(refused, 2000);
  for (std::size_t length = 0; length < sound.size() - 1; length += 7)
    EXPECT_THROW(Recipe::from_json(sound.substr(0, length)), std::invalid_argument);
}

TEST(Scenes, NamesStandForScenes) {
  EXPECT_EQ(expand_scene_name("train").size(), 5U);
  EXPECT_EQ(expand_scene_name("forest/seed-3..5"), (std::vector<std::string>{"forest/seed-3", "forest/seed-4", "forest/seed-5"}));
  EXPECT_EQ(expand_scene_name("arena/hall"), std::vector<std::string>{"arena/hall"});
  EXPECT_EQ(expand_scene_name("forest/seed-x"), std::vector<std::string>{"forest/seed-x"});
  EXPECT_THROW(expand_scene_name("forest/seed-5..3"), std::invalid_argument);
  EXPECT_THROW(expand_scene_name("forest/seed-0..999999999999999999"), std::invalid_argument);
  for (const SceneSet& set : scene_sets()) {
    for (const std::string_view name : set.scenes) EXPECT_NE(load_scene(std::string(name), FLOCKSTEP_SCENES), nullptr);
  }
  EXPECT_EQ(load_scene("playground/seed-4", "")->content_hash(), load_scene("playground/seed-4", "/nowhere")->content_hash());
  EXPECT_THROW(load_scene("playground/train-1", "/nowhere"), std::invalid_argument);
  EXPECT_REFUSED(load_scene("playground/trian-1", FLOCKSTEP_SCENES), "'playground/trian-1' ... 'playground/train-1', ");
}

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
  return refusal([&] { (void)config_from_json<Config>(text, "recipe.json"); });
}

// A configuration in which every field differs from its default. The values are written by hand.
BatchConfig unusual() {
  BatchConfig config{.num_envs = 3, .drones_per_env = 2, .num_threads = 5, .block_size = 7};
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
  const std::string text =
      R"({"position_noise_std_m":0.1,"orientation_noise_std_deg":0.0,"velocity_noise_std_mps":null,"position_random_walk":0.0,)"
      R"("yaw_random_walk":0.0,"drift_std_m":0.0,"drift_time_s":30.0,)"
      R"("rate_hz":null,"latency_s":0.0,"jitter_s":0.0,"loss":0.0})";
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
  BatchConfig with_imu{.imus = {ImuConfig()}};
  with_imu.dynamics.motion = Motion::rotors;
  with_imu.clock.physics_hz = 500.0F;
  comes_back(with_imu);
  const std::string given = R"({"imus": [{}], "dynamics": {"motion": "rotors"}, "clock": {"physics_hz": 500}})";
  EXPECT_EQ(config_to_json(config_from_json<BatchConfig>(given, "x")), config_to_json(with_imu));
  comes_back(CameraConfig());
  comes_back(ClockConfig());
  comes_back(ColorRange());
  comes_back(DynamicsConfig());
  comes_back(EpisodeConfig());
  comes_back(LidarConfig());
  comes_back(NavigationReward());
  comes_back(ObservationConfig());
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
  lidar.offset_m[1] = kNan;
  EXPECT_THROW((void)json_of(lidar), std::invalid_argument);
  lidar.offset_m[1] = std::numeric_limits<float>::infinity();
  EXPECT_THROW((void)json_of(lidar), std::invalid_argument);
}

TEST(ConfigJson, RefusesInvalidConfigs) {
  const std::vector<std::pair<std::string, std::string>> cases{
      {R"({"episode": {"frame_skp": 2}})", "episode.frame_skp: ... stagger_first_episode"},
      {R"({"quite_another": 2})", "quite_another: ... drones_per_env"},
      {R"([])", "configuration: ... object ... []"},
      {R"({"episode": 3})", "episode: ... 3"},
      {R"({"episode": null})", "episode: ... object"},
      {R"({"cameras": {}})", "cameras: ... array ... {}"},
      {R"({"cameras": [{}, {"width_px": 0}]})", "cameras[1].width_px: ... [1, 8192] ... 0"},
      {R"({"cameras": [{"outputs": ["rgb", "dept"]}]})", "cameras[0].outputs[1]: ... semantic"},
      {R"({"cameras": [{"outputs": "rgb"}]})", R"(cameras[0].outputs: ... "rgb")"},
      {R"({"cameras": [{"outputs": [1]}]})", "cameras[0].outputs[0]: ... 1"},
      {R"({"cameras": [{"outputs": []}]})", "camera.outputs: ... one"},
      {R"({"cameras": [{"name": "a/b"}]})", R"(cameras[0].name: ... "a/b")"},
      {R"({"cameras": [{"name": 3}]})", "cameras[0].name: ... 3"},
      {R"({"cameras": [{"shadows": 1}]})", "cameras[0].shadows: ... 1"},
      {R"({"cameras": [{"samples_per_pixel": 5}]})", "cameras[0].samples_per_pixel: expected 1, 4, 9 or 16, got 5"},
      {R"({"cameras": [{"resize": [1, 2, 3]}]})", "cameras[0].resize: ... 2 ... [1,2,3]"},
      {R"({"cameras": [{"resize": [1, 2.5]}]})", "cameras[0].resize[1]: ... 2.5"},
      {R"({"cameras": [{"depth_kind": "rang"}]})", "cameras[0].depth_kind: ... planar"},
      {R"({"cameras": [{"depth_kind": 1}]})", "cameras[0].depth_kind: ... 1"},
      {R"({"cameras": [{}, {}]})", "camera.name: ... camera"},
      {R"({"lidars": [{"offset_m": [0, 0, -101]}]})", "lidars[0].offset_m[2]: ... +-100 ... -101"},
      {R"({"lidars": [{"offset_m": [0, "0", 0]}]})", R"(lidars[0].offset_m[1]: ... +-100 ... "0")"},
      {R"({"lidars": [{"quat_wxyz": [1, 1, 0, 0]}]})", "lidars[0].quat_wxyz: ... quaternion"},
      {R"({"lidars": [{"max_range_m": 1e300}]})", "lidars[0].max_range_m: ... 0 ... 1e+300"},
      {R"({"lidars": [{"max_range_m": 0}]})", "lidars[0].max_range_m: ... 0 ... 0"},
      {R"({"lidars": [{"azimuth_deg": [0]}]})", "lidar.elevation_deg: ... azimuth_deg"},
      {R"({"num_envs": -1})", "num_envs: ... [0, 1048576] ... -1"},
      {R"({"num_envs": 1.0})", "num_envs: ... [0, 1048576] ... 1.0"},
      {R"({"num_envs": 1e300})", "num_envs: ... [0, 1048576] ... 1e+300"},
      {R"({"num_envs": true})", "num_envs: ... [0, 1048576]"},
      {R"({"num_envs": 4294967297})", "num_envs: ... -2147483648 ... 2147483647 ... 4294967297"},
      {R"({"num_envs": 9223372036854775808})", "num_envs: ... -2147483648 ... 2147483647"},
      {R"({"num_envs": 18446744073709551617})", "num_envs: ... [0, 1048576] ... 1.8446744073709552e+19"},
      {R"({"num_envs": 1, "num_envs": 1})", "recipe.json: ... field"},
      {R"({"num_envs": NaN})", "recipe.json: not valid JSON"},
      {R"({"num_envs": 1e999})", "recipe.json: not valid JSON"},
      {R"({"num_envs": 1)", "recipe.json: not valid JSON"},
      {"", "recipe.json: not valid JSON"},
      {std::string(100'000, '['), "recipe.json: ... 32"},
      {R"({"lidars": [{"azimuth_deg": )" + std::string(1, '[') + "0" +
           [] {
             std::string zeros;
             for (int i = 0; i < LidarConfig::kMaxRays; ++i) zeros += ",0";
             return zeros;
           }() +
           "]}]}",
       "lidars[0].azimuth_deg: ... 262144 ... 262145"},
  };
  for (const auto& [text, expected] : cases) EXPECT_TRUE(names(message_of<BatchConfig>(text), expected)) << text.substr(0, 100);
  EXPECT_TRUE(names(message_of<PlaygroundConfig>(R"({"seed": -1})"), "seed: ... 0 ... 18446744073709551615 ... -1"));
  EXPECT_TRUE(names(message_of<PlaygroundConfig>(R"({"size_m": [14, 14, 1]})"), "size_m[2]: ... [1.5, 100] ... 1"));
  const std::string long_key(1'000'000, 'x');
  EXPECT_LT(message_of<BatchConfig>("{\"" + long_key + "\": 1}").size(), 500U);
}

}  // namespace
}  // namespace flockstep
