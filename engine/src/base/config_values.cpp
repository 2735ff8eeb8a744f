#include "base/config_values.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/excerpt.hpp"
#include "base/json_document.hpp"
#include "base/nearest_name.hpp"
#include "base/require.hpp"
#include "flockstep/sensors/lidar.hpp"

namespace flockstep::config_values {
namespace {

[[noreturn]] void refuse_json(const std::string& path, const std::string& expected, const Json& got) {
  refuse(path.empty() ? "configuration" : path, expected, json::excerpt_of(got));
}

[[noreturn]] void refuse_name(const std::string& path, const std::string& name, std::span<const std::string_view> known) {
  std::string expected;
  for (const std::string_view one : known) expected += (expected.empty() ? "one of " : ", ") + std::string(one);
  refuse(path, expected, excerpt(name) + did_you_mean(name, known));
}

std::vector<std::string_view> names_of(const Members& members) {
  std::vector<std::string_view> names;
  for (const Member& one : members) names.push_back(one.name);
  return names;
}

template <class Integer>
void read_integer(const Json& json, const FieldInfo& info, const std::string& path, Integer& value) {
  constexpr Integer kMin = std::numeric_limits<Integer>::min(), kMax = std::numeric_limits<Integer>::max();
  if (!json.is_number_integer()) refuse_json(path, expected_number(info.limits, true), json);
  const bool fits = json.is_number_unsigned() ? std::in_range<Integer>(json.get<std::uint64_t>())
                                              : std::in_range<Integer>(json.get<std::int64_t>());
  if (!fits) refuse_json(path, "an integer from " + std::to_string(kMin) + " to " + std::to_string(kMax), json);
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

}  // namespace

std::string member(const std::string& path, const std::string& key) { return path.empty() ? key : path + '.' + key; }

std::string element(const std::string& path, std::size_t index) { return path + '[' + std::to_string(index) + ']'; }

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

void read_value(const Json& json, const FieldInfo&, const std::string& path, bool& value) {
  if (!json.is_boolean()) refuse_json(path, "true or false", json);
  value = json.get<bool>();
}

void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::string& value) {
  if (!json.is_string()) refuse_json(path, "a string", json);
  value = json.get<std::string>();
  check_text(excerpt(value), info.form, path);
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
  constexpr std::size_t kMax = LidarConfig::kMaxRays;
  if (!json.is_array()) refuse_json(path, "an array", json);
  require(json.size() <= kMax, path, "at most " + std::to_string(kMax) + " values", json.size());
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

}  // namespace flockstep::config_values
