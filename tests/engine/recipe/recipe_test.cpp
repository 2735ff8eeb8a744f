#include "flockstep/recipe.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "batch_helpers.hpp"
#include "flockstep/scenes.hpp"
#include "random.hpp"

namespace flockstep {
namespace {

const RecipeAccess kBundled{.scenes = FLOCKSTEP_SCENES};

std::string refusal_of(const std::string& json) {
  try {
    Recipe::from_json(json);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "nothing was refused";
}

std::string refusal_of(const Recipe& recipe, const RecipeAccess& access = kBundled) {
  try {
    make_batch(recipe, access);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "nothing was refused";
}

void expect_has(const std::string& text, const std::string& part) { EXPECT_NE(text.find(part), std::string::npos) << text; }

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
  EXPECT_EQ(hover.batch.dynamics.motion, defaults.dynamics.motion);
  EXPECT_EQ(hover.batch.clock.policy_hz, defaults.clock.policy_hz);
  const Recipe swap = Recipe::from_json(R"({"task": {"name": "swap"}})");
  EXPECT_EQ(swap.batch.drones_per_env, make_task(SwapConfig{})->defaults().drones_per_env);
  EXPECT_EQ(swap.batch.interaction, Interaction::collide);
  const Recipe pixels = Recipe::from_json(R"({"task": {"name": "navigation", "observation": "pixels"}})");
  EXPECT_EQ(pixels.worlds, std::vector<std::string>{"camera-train"});
  EXPECT_EQ(pixels.batch.cameras.size(), 1U);
  EXPECT_EQ(std::get<NavigationConfig>(pixels.task).action, NavigationConfig::observing(ObservationKind::pixels).action);
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
  BatchConfig config = testing::lidar_batch(5);
  config.pose_sensor.position_noise_std_m = 0.01F;
  config.episode = {.autoreset_mode = AutoresetMode::same_step, .max_episode_steps = 11};
  Batch by_hand(config, {testing::playground("validation-1"), testing::playground("validation-2")},
                make_task(NavigationConfig{.step_m = 0.2F}));
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
  expect_has(refusal_of(recipe),
             "task.name: expected one of \"navigation\", \"hover\", \"track\", \"race\", \"dodge\", \"swap\", \"formation\", got "
             "\"mine/ReachHeight-v0\"");
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
    const std::string refusal = refusal_of(json);
    EXPECT_EQ(refusal.substr(0, std::string(place).size()), place) << refusal;
    expect_has(refusal, hint);
  }
  expect_has(refusal_of(R"({"num_envs": 1e300})"), "num_envs");
  expect_has(refusal_of(R"({"num_envs": -1})"), "num_envs");
  expect_has(refusal_of(R"({"worlds": "train"})"), "worlds: expected an array of names");
  expect_has(refusal_of(R"({"worlds": [1]})"), "worlds: expected an array of names");
  expect_has(refusal_of(R"({"drone": 5})"), "drone: expected a name or an object");
  expect_has(refusal_of(R"([])"), "recipe: expected an object");
  expect_has(refusal_of(R"({"task": "hover"})"), "task: expected null or an object");
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
  EXPECT_EQ(refusal_of(recipe), "nothing was refused");
  EXPECT_NE(refusal_of(recipe, {}), "nothing was refused") << "no folder is known";
  EXPECT_EQ(refusal_of(recipe, {.allows_files = true}), "nothing was refused");
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
               "worlds: expected at most " + std::to_string(most) + " worlds (max_worlds)");
  }
  recipe.worlds = {"bench/simple", "bench/simple", "playground/seed-1..2"};
  EXPECT_EQ(refusal_of(recipe, {.max_worlds = 4}), "nothing was refused");
  EXPECT_EQ(cost_of_scenes({"forest/seed-1", "forest/seed-1", "forest/seed-0..1"}, 1000), 62U);
}

TEST(Recipe, NamesItsFormatAndRefusesAnother) {
  expect_has(Recipe::for_task(HoverConfig{}).to_json(), "\"flockstep_recipe\": 1");
  EXPECT_EQ(refusal_of(R"({"flockstep_recipe": 1, "task": {"name": "hover"}})"), "nothing was refused");
  EXPECT_EQ(refusal_of(R"({"flockstep_recipe": 2, "fog": {}})"),
            "recipe: /flockstep_recipe: expected version 1, got 2 (written for a newer flockstep: install that one)");
}

TEST(Recipe, SurvivesAnyText) {
  Recipe recipe = Recipe::for_task(NavigationConfig{});
  recipe.batch.cameras = {{.name = "front"}};
  const std::string sound = recipe.to_json();
  testing::Random random(5);
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
    try {
      Recipe::from_json(text);
    } catch (const std::invalid_argument&) {
      ++refused;
    }
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
  try {
    load_scene("playground/trian-1", FLOCKSTEP_SCENES);
    FAIL();
  } catch (const std::invalid_argument& error) {
    expect_has(error.what(), "unknown scene 'playground/trian-1'. Did you mean 'playground/train-1', ");
  }
}

}  // namespace
}  // namespace flockstep
