#include "recipe/config_json.hpp"

#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "base/excerpt.hpp"
#include "base/json_document.hpp"
#include "base/nearest_name.hpp"
#include "base/require.hpp"
#include "flockstep/tasks.hpp"

namespace flockstep {
namespace {

using Json = nlohmann::json;
using OrderedJson = nlohmann::ordered_json;

}  // namespace

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
    if constexpr (requires { &Config::observing; }) {  // the other defaults depend on the observation
      if (fields.contains("observation")) {
        read_config(Json{{"observation", fields["observation"]}}, "task", config);
        config = Config::observing(config.observation);
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

}  // namespace flockstep
