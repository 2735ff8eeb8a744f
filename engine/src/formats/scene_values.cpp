#include "formats/scene_values.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/check_fields.hpp"
#include "world/scene_description.hpp"

namespace flockstep {

using json::JsonField;

namespace {

// Names the required keys of each alternative: "file" or "vertices" and "triangles".
std::string text_of_alternatives(std::span<const KeyRule> rules) {
  std::string text;
  int number = 0;
  for (const KeyRule& rule : rules) {
    if (rule.alternative == 0 || !rule.is_required) continue;
    if (number != 0) text += rule.alternative == number ? " and " : " or ";
    text += '"' + std::string(rule.name) + '"';
    number = rule.alternative;
  }
  return text;
}

}  // namespace

void check_keys(const JsonField& field, std::span<const KeyRule> rules) {
  if (!field.value.is_object()) refuse(field, "an object");
  for (const auto& [name, value] : field.value.items()) {
    if (std::ranges::find(rules, name, &KeyRule::name) != rules.end()) continue;
    std::vector<std::string_view> known;
    for (const KeyRule& rule : rules) known.push_back(rule.name);
    json::refuse_unknown(field, name, known);
  }
  int alternative = 0;
  bool has_alternatives = false, are_several = false;
  for (const KeyRule& rule : rules) {
    has_alternatives |= rule.alternative != 0;
    if (rule.alternative == 0 || !field.value.contains(rule.name)) continue;
    are_several |= alternative != 0 && alternative != rule.alternative;
    alternative = rule.alternative;
  }
  if (are_several || (has_alternatives && alternative == 0)) fail(field, "expected either " + text_of_alternatives(rules));
  for (const KeyRule& rule : rules) {
    if (rule.is_required && (rule.alternative == 0 || rule.alternative == alternative)) require(field, rule.name);
  }
}

void check_count(std::size_t most, const JsonField& field, const char* name) {
  if (most == 0 || field.value.size() <= most) return;
  refuse(field, "at most " + std::to_string(most) + ' ' + name, field.value.size());
}

std::size_t read_name(const JsonField& field, std::span<const char* const> names) {
  const auto found = std::ranges::find_if(names, [&](const char* known) { return field.value == known; });
  if (found != names.end()) return static_cast<std::size_t>(found - names.begin());
  std::string expected;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (i > 0) expected += i + 1 == names.size() ? " or " : ", ";
    expected += '"' + std::string(names[i]) + '"';
  }
  refuse(field, expected);
}

void read_key(const JsonField& field, const FieldInfo& info, double& value) {
  value = field.value.is_number() ? field.value.get<double>() : std::numeric_limits<double>::quiet_NaN();
  if (!info.limits.contain(value)) refuse(field, expected_number(info.limits, false));
}

void read_key(const JsonField& field, const FieldInfo& info, float& value) {
  double number = 0.0;
  read_key(field, info, number);
  value = static_cast<float>(number);
}

void read_key(const JsonField& field, const FieldInfo&, bool& value) {
  if (!field.value.is_boolean()) refuse(field, "true or false");
  value = field.value.get<bool>();
}

void read_key(const JsonField& field, const FieldInfo&, std::string& value) {
  if (!field.value.is_string()) refuse(field, "a string");
  value = field.value.get<std::string>();
}

void read_key(const JsonField& field, const FieldInfo& info, std::uint16_t& value) {
  const double number = field.value.is_number() ? field.value.get<double>() : std::numeric_limits<double>::quiet_NaN();
  if (!info.limits.contain(number) || number != std::floor(number)) refuse(field, expected_number(info.limits, true));
  value = static_cast<std::uint16_t>(number);
}

void read_key(const JsonField& field, const FieldInfo&, keys::Index& value) {
  constexpr auto kMost = static_cast<std::uint64_t>(std::numeric_limits<keys::Index>::max());
  const bool is_index = field.value.is_number_unsigned() && field.value.get<std::uint64_t>() <= kMost;
  value = is_index ? field.value.get<keys::Index>() : -1;
}

void read_key(const JsonField& field, const FieldInfo&, keys::Text& value) {
  if (!field.value.is_string()) refuse(field, "a string");
  value.field.emplace(field);
}

void require_array_of(std::size_t size, const JsonField& field) {
  if (!field.value.is_array() || field.value.size() != size) refuse(field, "an array of " + std::to_string(size));
}

std::array<float, 3> direction_of(const JsonField& numbers) {
  const Vec3d given(numbers.value[0].get<double>(), numbers.value[1].get<double>(), numbers.value[2].get<double>());
  if (given.isZero(0.0)) refuse(numbers, "a direction that is not 0");
  const Vec3 unit = unit_direction(given);
  return {unit.x(), unit.y(), unit.z()};
}

}  // namespace flockstep
