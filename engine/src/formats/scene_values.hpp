// Reads the objects of scene_keys.hpp from a scene file and checks them against their fields(). Invalid values throw
// std::invalid_argument.
#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "base/config_values.hpp"
#include "base/json_document.hpp"
#include "world/scene_keys.hpp"

namespace flockstep {

using Vec3d = Eigen::Vector3d;  // rounded to float32 once, after all arithmetic

// A key of an object, and if it may be left out; the type of its member tells.
struct KeyRule {
  std::string_view name;
  int alternative = 0;  // 0: none
  bool is_required = false;
};
template <class Struct, class Value>
constexpr KeyRule rule_of(const FieldPointer<Struct, Value>& key) {
  return {key.name};
}
template <class Struct, class Value, bool kIsRequired, int kAlternative>
constexpr KeyRule rule_of(const FieldPointer<Struct, keys::Key<Value, kIsRequired, kAlternative>>& key) {
  return {key.name, kAlternative, kIsRequired};
}

// Rejects values that are not objects, unknown keys, missing ones, and keys of several alternatives.
void check_keys(const json::JsonField& field, std::span<const KeyRule> rules);
template <class Object>
void check_keys(const json::JsonField& field) {
  static constexpr std::array kRules = kFields<Object>.apply([](const auto&... all) { return std::array{rule_of(all)...}; });
  check_keys(field, kRules);
}

void check_count(std::size_t most, const json::JsonField& field, const char* name);  // 0: any number

using config_values::read_choice;
using config_values::read_value;
void read_value(const json::JsonField& field, const FieldInfo& info, std::uint16_t& value);  // as in JSON Schema: 7 or 7.0
void read_value(const json::JsonField& field, const FieldInfo& info, keys::Index& index);
void read_value(const json::JsonField& field, const FieldInfo& info, keys::Text& value);
inline void read_value(const json::JsonField& field, const FieldInfo&, keys::TextOrTexts& value) { value.field.emplace(field); }
template <class Value, bool kIsRequired, int kAlternative>
void read_value(const json::JsonField& field, const FieldInfo& info, keys::Key<Value, kIsRequired, kAlternative>& key) {
  read_value(field, info, key.value);
}
template <HasFields Object>
  requires std::derived_from<Object, keys::Object>
void read_value(const json::JsonField& field, const FieldInfo&, Object& object) {
  check_keys<Object>(field);
  for_each_key<Object>([&](const auto& key) {
    if (const auto given = find(field, key.name)) read_value(*given, key.info, object.*(key.member));
  });
}

// Returns an object of a scene file.
template <class Object>
Object read_object(const json::JsonField& field) {
  Object object;
  read_value(field, {}, object);
  return object;
}

}  // namespace flockstep
