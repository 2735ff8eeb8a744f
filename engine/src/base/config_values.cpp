#include "base/config_values.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/excerpt.hpp"
#include "base/nearest_name.hpp"
#include "base/require.hpp"
#include "flockstep/sensors/lidar.hpp"

namespace flockstep::config_values {
namespace {

[[noreturn]] void refuse_name(const JsonField& field, const std::string& name, std::span<const std::string_view> known) {
  std::string expected;
  for (const std::string_view one : known) expected += (expected.empty() ? "one of " : ", ") + std::string(one);
  refuse(field, expected, excerpt(name) + did_you_mean(name, known));
}

std::vector<std::string_view> names_of(const Members& members) {
  std::vector<std::string_view> names;
  for (const Member& one : members) names.push_back(one.name);
  return names;
}

template <class Integer>
void read_integer(const JsonField& field, const FieldInfo& info, Integer& value) {
  constexpr Integer kMin = std::numeric_limits<Integer>::min(), kMax = std::numeric_limits<Integer>::max();
  const json::Json& given = field.value;
  if (!given.is_number_integer()) refuse(field, expected_number(info.limits, true));
  const bool fits = given.is_number_unsigned() ? std::in_range<Integer>(given.get<std::uint64_t>())
                                               : std::in_range<Integer>(given.get<std::int64_t>());
  if (!fits) refuse(field, "an integer from " + std::to_string(kMin) + " to " + std::to_string(kMax));
  value = given.get<Integer>();
  if (!info.limits.contain(value)) refuse(field, expected_number(info.limits, true));
}

template <class Real>
void read_real(const JsonField& field, const FieldInfo& info, Real& value) {
  constexpr auto kMax = static_cast<double>(std::numeric_limits<Real>::max());
  const double number = field.value.is_number() ? field.value.get<double>() : std::numeric_limits<double>::infinity();
  if (std::abs(number) <= kMax) value = static_cast<Real>(number);
  if (!(std::abs(number) <= kMax && info.limits.contain(value))) refuse(field, expected_number(info.limits, false));
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

void read_value(const JsonField& field, const FieldInfo&, bool& value) {
  if (!field.value.is_boolean()) refuse(field, "true or false");
  value = field.value.get<bool>();
}

void read_value(const JsonField& field, const FieldInfo& info, std::string& value) {
  value = text(field);
  if (info.form != Form::any) check_text(excerpt(value), info.form, name_of(field));
}

void read_value(const JsonField& field, const FieldInfo& info, int& value) { read_integer(field, info, value); }
void read_value(const JsonField& field, const FieldInfo& info, std::uint64_t& value) { read_integer(field, info, value); }
void read_value(const JsonField& field, const FieldInfo& info, float& value) { read_real(field, info, value); }
void read_value(const JsonField& field, const FieldInfo& info, double& value) { read_real(field, info, value); }

void read_flags(const JsonField& field, const Members& members, void* flags) {
  const std::size_t count = require_array(field, "an array of names").size();
  const auto flag = [&](const Member& one) -> bool& { return *reinterpret_cast<bool*>(static_cast<char*>(flags) + one.offset); };
  for (const Member& one : members) flag(one) = false;
  for (std::size_t i = 0; i < count; ++i) {
    const JsonField given = child(field, i);
    if (!given.value.is_string()) refuse(given, "a name");
    const auto& name = given.value.get_ref<const std::string&>();
    const auto found = std::ranges::find(members, name, &Member::name);
    if (found == members.end()) refuse_name(given, name, names_of(members));
    flag(*found) = true;
  }
}

std::size_t read_name(const JsonField& field, std::span<const char* const> names) {
  if (!field.value.is_string()) refuse(field, "a name");
  const auto& name = field.value.get_ref<const std::string&>();
  const auto found = std::ranges::find(names, name);
  if (found == names.end()) refuse_name(field, name, std::vector<std::string_view>(names.begin(), names.end()));
  return static_cast<std::size_t>(found - names.begin());
}

void read_object(const JsonField& field, const Members& members, void* config) {
  if (!field.value.is_object()) refuse(field, "an object");
  for (const auto& [key, value] : field.value.items()) {
    if (std::ranges::find(members, key, &Member::name) != members.end()) continue;
    if (!field.is_config) json::refuse_unknown(field, key, names_of(members));
    refuse_name(child(field, key, value), key, names_of(members));
  }
  for (const Member& one : members) {
    if (const auto given = find(field, one.name)) one.type->read(*given, *one.info, static_cast<char*>(config) + one.offset);
  }
}

std::size_t size_of_list(const JsonField& field) {
  constexpr std::size_t kMax = LidarConfig::kMaxRays;  // the longest list of a configuration
  const std::size_t size = require_array(field, "an array").size();
  if (field.is_config && size > kMax) refuse(field, "at most " + std::to_string(kMax) + " values", size);
  return size;
}

void require_array_of(std::size_t size, const JsonField& field) {
  if (!field.value.is_array() || field.value.size() != size) refuse(field, "an array of " + std::to_string(size));
}

}  // namespace flockstep::config_values
