#include "formats/scene_values.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/check_fields.hpp"

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

void read_value(const JsonField& field, const FieldInfo& info, std::uint16_t& value) {
  const double number = field.value.is_number() ? field.value.get<double>() : std::numeric_limits<double>::quiet_NaN();
  if (!info.limits.contain(number) || number != std::floor(number)) refuse(field, expected_number(info.limits, true));
  value = static_cast<std::uint16_t>(number);
}

void read_value(const JsonField& field, const FieldInfo&, keys::Index& index) {
  const json::Json& given = field.value;
  if (given.is_number_unsigned() && std::in_range<std::int32_t>(given.get<std::uint64_t>()))
    index.value = given.get<std::int32_t>();
}

void read_value(const JsonField& field, const FieldInfo&, keys::Text& value) {
  text(field);
  value.field.emplace(field);
}

}  // namespace flockstep
