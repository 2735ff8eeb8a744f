#include "recipe/config_json.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/check_fields.hpp"
#include "base/excerpt.hpp"
#include "base/field_offsets.hpp"
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

std::string member(const std::string& path, const std::string& key) { return path.empty() ? key : path + '.' + key; }
std::string element(const std::string& path, std::size_t index) { return path + '[' + std::to_string(index) + ']'; }

[[noreturn]] void refuse_json(const std::string& path, const std::string& expected, const Json& got) {
  refuse(path.empty() ? "configuration" : path, expected, json::excerpt_of(got));
}

[[noreturn]] void refuse_name(const std::string& path, const std::string& name, std::span<const std::string_view> known) {
  std::string expected;
  for (const std::string_view one : known) expected += (expected.empty() ? "one of " : ", ") + std::string(one);
  refuse(path, expected, excerpt(name) + did_you_mean(name, known));
}

// Writes and reads values of one type.
struct ValueType {
  OrderedJson (*write)(const void* value, const std::string& path);
  void (*read)(const Json& json, const FieldInfo& info, const std::string& path, void* value);
};

// A field of a configuration. Only type-dependent code is a template, because each instance costs compile time.
struct Member {
  std::string_view name;
  const FieldInfo* info;
  std::ptrdiff_t offset;
  const ValueType* type;
};
using Members = std::vector<Member>;

template <class Config>
const Members& members_of();

// Returns true for a struct of bools.
template <class Config>
consteval bool are_all_bools() {
  return std::apply([]<class... Values>(const FieldPointer<Config, Values>&...) { return (std::is_same_v<Values, bool> && ...); },
                    kFields<Config>);
}

std::vector<std::string_view> names_of(const Members& members) {
  std::vector<std::string_view> names;
  for (const Member& one : members) names.push_back(one.name);
  return names;
}

// -- Writing

OrderedJson written(bool value, const std::string&) { return value; }
OrderedJson written(int value, const std::string&) { return value; }
OrderedJson written(std::uint64_t value, const std::string&) { return value; }
OrderedJson written(const std::string& value, const std::string&) { return value; }
OrderedJson written(float value, const std::string& path) {
  require(std::isfinite(value), path, "a finite number", value);
  return json::shortest(static_cast<double>(value));
}
OrderedJson written(double value, const std::string& path) {
  require(std::isfinite(value), path, "a finite number", value);
  return value;
}
OrderedJson written_object(const Members& members, const void* config, const std::string& path) {
  OrderedJson json = OrderedJson::object();
  for (const Member& one : members) {
    const std::string name(one.name);
    json[name] = one.type->write(static_cast<const char*>(config) + one.offset, member(path, name));
  }
  return json;
}
OrderedJson written_flags(const Members& members, const void* flags) {
  OrderedJson json = OrderedJson::array();
  for (const Member& one : members) {
    if (*reinterpret_cast<const bool*>(static_cast<const char*>(flags) + one.offset)) json.push_back(one.name);
  }
  return json;
}

template <class Value>
OrderedJson written(const std::optional<Value>& value, const std::string& path);
template <class Values>
  requires requires(Values values) {
    values.size();
    values[0];
  }
OrderedJson written(const Values& values, const std::string& path);

template <class Enum>
  requires std::is_enum_v<Enum>
OrderedJson written(Enum value, const std::string&) {
  return EnumNames<Enum>::kNames.at(static_cast<std::size_t>(value));
}
template <HasFields Config>
OrderedJson written(const Config& config, const std::string& path) {
  if constexpr (are_all_bools<Config>()) return written_flags(members_of<Config>(), &config);
  return written_object(members_of<Config>(), &config, path);
}
template <class Value>
OrderedJson written(const std::optional<Value>& value, const std::string& path) {
  return value ? written(*value, path) : OrderedJson();
}
template <class Values>
  requires requires(Values values) {
    values.size();
    values[0];
  }
OrderedJson written(const Values& values, const std::string& path) {
  OrderedJson list = OrderedJson::array();
  for (std::size_t i = 0; i < values.size(); ++i) list.push_back(written(values[i], element(path, i)));
  return list;
}

// -- Reading

void read_value(const Json& json, const FieldInfo&, const std::string& path, bool& value) {
  if (!json.is_boolean()) refuse_json(path, "true or false", json);
  value = json.get<bool>();
}

void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::string& value) {
  if (!json.is_string()) refuse_json(path, "a string", json);
  value = json.get<std::string>();
  check_text(excerpt(value), info.form, path);
}

template <class Integer>
void read_integer(const Json& json, const FieldInfo& info, const std::string& path, Integer& value) {
  constexpr Integer kLeast = std::numeric_limits<Integer>::min(), kGreatest = std::numeric_limits<Integer>::max();
  if (!json.is_number_integer()) refuse_json(path, expected_number(info.limits, true), json);
  const bool fits = json.is_number_unsigned() ? std::in_range<Integer>(json.get<std::uint64_t>())
                                              : std::in_range<Integer>(json.get<std::int64_t>());
  if (!fits) refuse_json(path, "an integer from " + std::to_string(kLeast) + " to " + std::to_string(kGreatest), json);
  value = json.get<Integer>();
  check_number(value, info.limits, path);
}

template <class Real>
void read_real(const Json& json, const FieldInfo& info, const std::string& path, Real& value) {
  if (!json.is_number()) refuse_json(path, expected_number(info.limits, false), json);
  const auto number = json.get<double>();
  if (std::abs(number) > static_cast<double>(std::numeric_limits<Real>::max())) {
    refuse_json(path, expected_number(info.limits, false), json);
  }
  value = static_cast<Real>(number);
  check_number(value, info.limits, path);
}

void read_flags(const Json& json, const std::string& path, const Members& members, void* flags) {
  if (!json.is_array()) refuse_json(path, "an array of names", json);
  const auto flag = [&](const Member& one) -> bool& { return *reinterpret_cast<bool*>(static_cast<char*>(flags) + one.offset); };
  for (const Member& one : members) flag(one) = false;
  for (std::size_t i = 0; i < json.size(); ++i) {
    if (!json[i].is_string()) refuse_json(element(path, i), "a name", json[i]);
    const auto& name = json[i].get_ref<const std::string&>();
    const auto found = std::ranges::find(members, name, &Member::name);
    if (found == members.end()) refuse_name(element(path, i), name, names_of(members));
    flag(*found) = true;
  }
}

std::size_t read_name(const Json& json, const std::string& path, std::span<const char* const> names) {
  if (!json.is_string()) refuse_json(path, "a name", json);
  const auto& name = json.get_ref<const std::string&>();
  const auto found = std::ranges::find(names, name);
  if (found == names.end()) refuse_name(path, name, std::vector<std::string_view>(names.begin(), names.end()));
  return static_cast<std::size_t>(found - names.begin());
}

void read_object(const Json& json, const std::string& path, const Members& members, void* config) {
  if (!json.is_object()) refuse_json(path, "an object", json);
  for (const auto& [key, value] : json.items()) {
    if (std::ranges::find(members, key, &Member::name) == members.end()) {
      refuse_name(member(path, excerpt(key)), key, names_of(members));
    }
  }
  for (const Member& one : members) {
    const std::string name(one.name);
    const auto given = json.find(name);
    if (given != json.end()) one.type->read(*given, *one.info, member(path, name), static_cast<char*>(config) + one.offset);
  }
}

void require_array(const Json& json, const std::string& path) {
  constexpr std::size_t kMost = LidarConfig::kMaxRays;
  if (!json.is_array()) refuse_json(path, "an array", json);
  require(json.size() <= kMost, path, "at most " + std::to_string(kMost) + " values", json.size());
}

void require_array_of(std::size_t size, const Json& json, const std::string& path) {
  if (!json.is_array() || json.size() != size) refuse_json(path, "an array of " + std::to_string(size), json);
}

void read_value(const Json& json, const FieldInfo& info, const std::string& path, int& value) {
  read_integer(json, info, path, value);
}
void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::uint64_t& value) {
  read_integer(json, info, path, value);
}
void read_value(const Json& json, const FieldInfo& info, const std::string& path, float& value) {
  read_real(json, info, path, value);
}
void read_value(const Json& json, const FieldInfo& info, const std::string& path, double& value) {
  read_real(json, info, path, value);
}
template <class Value>
void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::vector<Value>& values);
template <class Value, std::size_t kSize>
void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::array<Value, kSize>& values);

template <class Enum>
  requires std::is_enum_v<Enum>
void read_value(const Json& json, const FieldInfo&, const std::string& path, Enum& value) {
  value = static_cast<Enum>(read_name(json, path, EnumNames<Enum>::kNames));
}
template <HasFields Config>
void read_value(const Json& json, const FieldInfo&, const std::string& path, Config& config) {
  if constexpr (are_all_bools<Config>()) {
    read_flags(json, path, members_of<Config>(), &config);
  } else {
    read_object(json, path, members_of<Config>(), &config);
  }
}
template <class Value>
void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::optional<Value>& value) {
  if (json.is_null()) {
    value.reset();
  } else {
    read_value(json, info, path, value.emplace());
  }
}
template <class Value>
void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::vector<Value>& values) {
  require_array(json, path);
  values = std::vector<Value>(json.size());
  for (std::size_t i = 0; i < values.size(); ++i) read_value(json[i], info, element(path, i), values[i]);
}
template <class Value, std::size_t kSize>
void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::array<Value, kSize>& values) {
  require_array_of(kSize, json, path);
  for (std::size_t i = 0; i < kSize; ++i) read_value(json[i], info.of_element(i), element(path, i), values[i]);
  check_value(values, info, path);
}

template <class Value>
constexpr ValueType kValueType{
    [](const void* value, const std::string& path) { return written(*static_cast<const Value*>(value), path); },
    [](const Json& json, const FieldInfo& info, const std::string& path, void* value) {
      read_value(json, info, path, *static_cast<Value*>(value));
    }};

template <class Config>
const Members& members_of() {
  static const Members members = list_fields<Member, Config>(
      []<class Value>(const char* name, const FieldInfo* info, std::ptrdiff_t offset, std::type_identity<Value>) {
        return Member{name, info, offset, &kValueType<Value>};
      });
  return members;
}

}  // namespace

template <HasFields Config>
OrderedJson json_of(const Config& config) {
  return written(config, "");
}

template <HasFields Config>
void read_config(const Json& json, const std::string& path, Config& config) {
  read_value(json, {}, path, config);
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
FLOCKSTEP_CONFIG_JSON(CameraConfig);
FLOCKSTEP_CONFIG_JSON(CityConfig);
FLOCKSTEP_CONFIG_JSON(ClockConfig);
FLOCKSTEP_CONFIG_JSON(ColorRange);
FLOCKSTEP_CONFIG_JSON(DodgeConfig);
FLOCKSTEP_CONFIG_JSON(DynamicsConfig);
FLOCKSTEP_CONFIG_JSON(EpisodeConfig);
FLOCKSTEP_CONFIG_JSON(ForestConfig);
FLOCKSTEP_CONFIG_JSON(HoverConfig);
FLOCKSTEP_CONFIG_JSON(ImuConfig);
FLOCKSTEP_CONFIG_JSON(LidarConfig);
FLOCKSTEP_CONFIG_JSON(NavigationConfig);
FLOCKSTEP_CONFIG_JSON(NavigationReward);
FLOCKSTEP_CONFIG_JSON(OfficeConfig);
FLOCKSTEP_CONFIG_JSON(PlaygroundConfig);
FLOCKSTEP_CONFIG_JSON(PoseSensorConfig);
FLOCKSTEP_CONFIG_JSON(RaceConfig);
FLOCKSTEP_CONFIG_JSON(RaceTrackConfig);
FLOCKSTEP_CONFIG_JSON(TrackConfig);
FLOCKSTEP_CONFIG_JSON(WarehouseConfig);
FLOCKSTEP_CONFIG_JSON(WindConfig);
#undef FLOCKSTEP_CONFIG_JSON

}  // namespace flockstep
