#include "recipe/config_json.hpp"

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "base/config_values.hpp"
#include "base/excerpt.hpp"
#include "base/json_document.hpp"
#include "base/nearest_name.hpp"
#include "base/require.hpp"
#include "flockstep/config.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/tasks.hpp"

namespace flockstep {
namespace {

using Json = nlohmann::json;
using OrderedJson = nlohmann::ordered_json;

}  // namespace

template <HasFields Config>
OrderedJson json_of(const Config& config) {
  return config_values::written(config, "");
}

template <HasFields Config>
void read_config(const Json& json, const std::string& path, Config& config) {
  config_values::read_value({json, {}, path, true}, {}, config);
}

std::string names_of_tasks() {
  std::string text;
  for_each_task(
      [&]<class Config>(std::type_identity<Config>) { text += (text.empty() ? "" : ", ") + quoted_excerpt(Config::kName); });
  return text;
}

OrderedJson json_of(const TaskConfig& task) {
  return std::visit(
      []<class Config>(const Config& config) -> OrderedJson {
        if constexpr (std::is_same_v<Config, std::monostate>) {
          return nullptr;
        } else if constexpr (std::is_same_v<Config, RegisteredTask>) {
          return {{"name", config.id}};
        } else {
          OrderedJson object{{"name", Config::kName}};
          object.update(json_of(config));
          return object;
        }
      },
      task);
}

TaskConfig read_task(const Json& json) {
  if (json.is_null()) return {};
  if (!json.is_object() || !json.contains("name") || !json["name"].is_string()) {
    refuse("task", "null or an object with a \"name\"", json::excerpt_of(json));
  }
  const auto& name = json["name"].get_ref<const std::string&>();
  Json fields = json;
  fields.erase("name");
  TaskConfig task;
  for_each_task([&]<class Config>(std::type_identity<Config>) {
    if (name != Config::kName) return;
    Config config;
    if constexpr (std::is_same_v<Config, NavigationConfig>) {  // the other defaults depend on the observation
      if (fields.contains("observation")) {
        read_config(Json{{"observation", fields["observation"]}}, "task", config);
        config = NavigationConfig::observing(config.observation);
      }
    }
    read_config(fields, "task", config);
    task = std::move(config);
  });
  if (!std::holds_alternative<std::monostate>(task)) return task;
  // Ids have a namespace, as in Gymnasium: "mine/ReachHeight-v0". Anything else is a misspelt name.
  std::vector<std::string_view> names;
  for_each_task([&]<class Config>(std::type_identity<Config>) { names.emplace_back(Config::kName); });
  require(name.find('/') != std::string::npos, "task.name",
          names_of_tasks() + " or the id of a registered task, such as \"mine/ReachHeight-v0\"",
          quoted_excerpt(name) + did_you_mean(name, names));
  require(fields.empty(), "task", "only the name of a registered task (its settings are in the task itself)",
          json::excerpt_of(fields));
  return RegisteredTask{name};
}

#define FLOCKSTEP_CONFIG_JSON(Config)          \
  template OrderedJson json_of(const Config&); \
  template void read_config(const Json&, const std::string&, Config&)
FLOCKSTEP_CONFIG_JSON(Airframe);
FLOCKSTEP_CONFIG_JSON(BatchConfig);
FLOCKSTEP_CONFIG_JSON(BodyConfig);
FLOCKSTEP_CONFIG_JSON(BodyMotion);
FLOCKSTEP_CONFIG_JSON(CameraChange);
FLOCKSTEP_CONFIG_JSON(CameraConfig);
FLOCKSTEP_CONFIG_JSON(CityConfig);
FLOCKSTEP_CONFIG_JSON(ClockConfig);
FLOCKSTEP_CONFIG_JSON(ColorRange);
FLOCKSTEP_CONFIG_JSON(DynamicsConfig);
FLOCKSTEP_CONFIG_JSON(EpisodeConfig);
FLOCKSTEP_CONFIG_JSON(ForestConfig);
FLOCKSTEP_CONFIG_JSON(LidarChange);
FLOCKSTEP_CONFIG_JSON(LidarConfig);
FLOCKSTEP_CONFIG_JSON(Light);
FLOCKSTEP_CONFIG_JSON(NavigationReward);
FLOCKSTEP_CONFIG_JSON(OfficeConfig);
FLOCKSTEP_CONFIG_JSON(PlaygroundConfig);
FLOCKSTEP_CONFIG_JSON(PoseSensorConfig);
FLOCKSTEP_CONFIG_JSON(RaceTrackConfig);
FLOCKSTEP_CONFIG_JSON(WarehouseConfig);
FLOCKSTEP_CONFIG_JSON(WindConfig);
#undef FLOCKSTEP_CONFIG_JSON

}  // namespace flockstep
