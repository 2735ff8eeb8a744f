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
#include "base/nearest_name.hpp"
#include "base/require.hpp"
#include "flockstep/config.hpp"
#include "flockstep/hover.hpp"
#include "flockstep/navigation.hpp"
#include "flockstep/scenario.hpp"
#include "flockstep/track.hpp"
#include "world/json_document.hpp"

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
  const std::string shown = excerpt(name);
  refuse(path, expected, shown + (nearest_name(name, known).empty() ? "" : "." + did_you_mean(name, known)));
}

template <class Config>
auto names_of() {
  return std::apply([](const auto&... fields) { return std::array<std::string_view, sizeof...(fields)>{fields.name...}; },
                    kFields<Config>);
}

// True for a struct of bools.
template <class Config>
consteval bool are_all_bools() {
  return std::apply(
      [](const auto&... fields) {
        return (std::is_same_v<std::remove_cvref_t<decltype(std::declval<Config>().*(fields.member))>, bool> && ...);
      },
      kFields<Config>);
}

// -- Writing

OrderedJson written(float value, const std::string& path) {
  require(std::isfinite(value), path, "a finite number", value);
  return json::shortest(static_cast<double>(value));
}
OrderedJson written(double value, const std::string& path) {
  require(std::isfinite(value), path, "a finite number", value);
  return value;
}

template <class Value>
OrderedJson written(const Value& value, const std::string& path);
template <class Value>
OrderedJson written(const std::vector<Value>& values, const std::string& path);
template <class Value, std::size_t kSize>
OrderedJson written(const std::array<Value, kSize>& values, const std::string& path);
template <class Value>
OrderedJson written(const std::optional<Value>& value, const std::string& path) {
  return value ? written(*value, path) : OrderedJson();
}
template <class Values>
OrderedJson written_list(const Values& values, const std::string& path) {
  OrderedJson list = OrderedJson::array();
  for (std::size_t i = 0; i < values.size(); ++i) list.push_back(written(values[i], element(path, i)));
  return list;
}
template <class Value>
OrderedJson written(const std::vector<Value>& values, const std::string& path) {
  return written_list(values, path);
}
template <class Value, std::size_t kSize>
OrderedJson written(const std::array<Value, kSize>& values, const std::string& path) {
  return written_list(values, path);
}
template <class Value>
OrderedJson written(const Value& value, const std::string& path) {
  if constexpr (std::is_enum_v<Value>) {
    return EnumNames<Value>::kNames.at(static_cast<std::size_t>(value));
  } else if constexpr (HasFields<Value>) {
    OrderedJson json = are_all_bools<Value>() ? OrderedJson::array() : OrderedJson::object();
    for_each_field(value, [&](const auto& field, const auto& part) {
      if constexpr (!are_all_bools<Value>()) {
        json[field.name] = written(part, member(path, field.name));
      } else if (part) {
        json.push_back(field.name);
      }
    });
    return json;
  } else {
    return value;
  }
}

// -- Reading

void read(const Json& json, const FieldInfo&, const std::string& path, bool& value) {
  if (!json.is_boolean()) refuse_json(path, "true or false", json);
  value = json.get<bool>();
}

void read(const Json& json, const FieldInfo& info, const std::string& path, std::string& value) {
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

template <class Value>
void read(const Json& json, const FieldInfo& info, const std::string& path, Value& value);
template <class Value>
void read(const Json& json, const FieldInfo& info, const std::string& path, std::vector<Value>& values);
template <class Value, std::size_t kSize>
void read(const Json& json, const FieldInfo& info, const std::string& path, std::array<Value, kSize>& values);
template <class Value>
void read(const Json& json, const FieldInfo& info, const std::string& path, std::optional<Value>& value) {
  if (json.is_null()) {
    value.reset();
  } else {
    read(json, info, path, value.emplace());
  }
}
template <class Value>
void read(const Json& json, const FieldInfo& info, const std::string& path, std::vector<Value>& values) {
  constexpr std::size_t kMost = LidarConfig::kMaxRays;
  if (!json.is_array()) refuse_json(path, "an array", json);
  require(json.size() <= kMost, path, "at most " + std::to_string(kMost) + " values", json.size());
  values = std::vector<Value>(json.size());
  for (std::size_t i = 0; i < values.size(); ++i) read(json[i], info, element(path, i), values[i]);
}
template <class Value, std::size_t kSize>
void read(const Json& json, const FieldInfo& info, const std::string& path, std::array<Value, kSize>& values) {
  if (!json.is_array() || json.size() != kSize) refuse_json(path, "an array of " + std::to_string(kSize), json);
  for (std::size_t i = 0; i < kSize; ++i) read(json[i], info.of_element(i), element(path, i), values[i]);
  check_value(values, info, path);
}

template <class Flags>
void read_flags(const Json& json, const std::string& path, Flags& flags) {
  if (!json.is_array()) refuse_json(path, "an array of names", json);
  for_each_field(flags, [](const auto&, bool& flag) { flag = false; });
  for (std::size_t i = 0; i < json.size(); ++i) {
    if (!json[i].is_string()) refuse_json(element(path, i), "a name", json[i]);
    const auto& name = json[i].template get_ref<const std::string&>();
    bool is_known = false;
    for_each_field(flags, [&](const auto& field, bool& flag) {
      if (name == field.name) flag = is_known = true;
    });
    if (!is_known) refuse_name(element(path, i), name, names_of<Flags>());
  }
}

template <class Enum>
void read_enum(const Json& json, const std::string& path, Enum& value) {
  constexpr const auto& kNames = EnumNames<Enum>::kNames;
  if (!json.is_string()) refuse_json(path, "a name", json);
  const auto& name = json.get_ref<const std::string&>();
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if (name != kNames[i]) continue;
    value = static_cast<Enum>(i);
    return;
  }
  refuse_name(path, name, std::vector<std::string_view>(kNames.begin(), kNames.end()));
}

template <class Config>
void read_object(const Json& json, const std::string& path, Config& config) {
  if (!json.is_object()) refuse_json(path, "an object", json);
  const auto names = names_of<Config>();
  for (const auto& [key, value] : json.items()) {
    if (std::find(names.begin(), names.end(), key) == names.end()) refuse_name(member(path, excerpt(key)), key, names);
  }
  for_each_field(config, [&](const auto& field, auto& value) {
    const auto given = json.find(field.name);
    if (given != json.end()) read(*given, field.info, member(path, field.name), value);
  });
}

template <class Value>
void read(const Json& json, const FieldInfo& info, const std::string& path, Value& value) {
  if constexpr (std::is_enum_v<Value>) {
    read_enum(json, path, value);
  } else if constexpr (std::is_integral_v<Value>) {
    read_integer(json, info, path, value);
  } else if constexpr (std::is_floating_point_v<Value>) {
    read_real(json, info, path, value);
  } else if constexpr (are_all_bools<Value>()) {
    read_flags(json, path, value);
  } else {
    read_object(json, path, value);
  }
}

}  // namespace

template <HasFields Config>
OrderedJson json_of(const Config& config) {
  return written(config, "");
}

template <HasFields Config>
void read_config(const Json& json, const std::string& path, Config& config) {
  read_object(json, path, config);
}

template <HasFields Config>
std::string config_to_json(const Config& config) {
  return json_of(config).dump(1) + '\n';
}

template <HasFields Config>
Config config_from_json(const std::string& text, const std::string& source) {
  Config config;
  read_config(json::Document::parse(text, source)->root().value, "", config);
  config.validate();
  return config;
}

#define FLOCKSTEP_CONFIG_JSON(Config)                                  \
  template OrderedJson json_of(const Config&);                         \
  template void read_config(const Json&, const std::string&, Config&); \
  template std::string config_to_json(const Config&);                  \
  template Config config_from_json<Config>(const std::string&, const std::string&)
FLOCKSTEP_CONFIG_JSON(Airframe);
FLOCKSTEP_CONFIG_JSON(BatchConfig);
FLOCKSTEP_CONFIG_JSON(CameraConfig);
FLOCKSTEP_CONFIG_JSON(CityConfig);
FLOCKSTEP_CONFIG_JSON(ClockConfig);
FLOCKSTEP_CONFIG_JSON(ColorRange);
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
FLOCKSTEP_CONFIG_JSON(TrackConfig);
FLOCKSTEP_CONFIG_JSON(WarehouseConfig);
FLOCKSTEP_CONFIG_JSON(WindConfig);
#undef FLOCKSTEP_CONFIG_JSON

}  // namespace flockstep
