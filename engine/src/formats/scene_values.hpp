// Reads the objects of scene_keys.hpp from a scene file and checks them against their fields(). Invalid values throw
// std::invalid_argument.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <vector>

#include "base/interrupt.hpp"
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
  static constexpr std::array kRules =
      std::apply([](const auto&... all) { return std::array{rule_of(all)...}; }, kFields<Object>);
  check_keys(field, kRules);
}

void check_count(std::size_t most, const json::JsonField& field, const char* name);  // 0: any number

// Returns the position of a name in a list of them.
std::size_t read_name(const json::JsonField& field, std::span<const char* const> names);
template <class Enum>
Enum read_choice(const json::JsonField& field) {
  return static_cast<Enum>(read_name(field, EnumNames<Enum>::kNames));
}

void read_key(const json::JsonField& field, const FieldInfo& info, double& value);
void read_key(const json::JsonField& field, const FieldInfo& info, float& value);
void read_key(const json::JsonField& field, const FieldInfo& info, bool& value);
void read_key(const json::JsonField& field, const FieldInfo& info, std::string& value);
void read_key(const json::JsonField& field, const FieldInfo& info, std::uint16_t& value);  // as in JSON Schema: 7 or 7.0
void read_key(const json::JsonField& field, const FieldInfo& info, keys::Index& value);    // -1 if it is no index
void read_key(const json::JsonField& field, const FieldInfo& info, keys::Text& value);
inline void read_key(const json::JsonField& field, const FieldInfo&, keys::TextOrTexts& value) { value.field.emplace(field); }

void require_array_of(std::size_t size, const json::JsonField& field);
std::array<float, 3> direction_of(const json::JsonField& numbers);

template <class Enum>
  requires std::is_enum_v<Enum>
void read_key(const json::JsonField& field, const FieldInfo&, Enum& value) {
  value = read_choice<Enum>(field);
}
template <class Value, std::size_t kSize>
void read_key(const json::JsonField& field, const FieldInfo& info, std::array<Value, kSize>& values) {
  require_array_of(kSize, field);
  for (std::size_t i = 0; i < kSize; ++i) read_key(child(field, i), info, values[i]);
  if constexpr (std::is_same_v<std::array<Value, kSize>, std::array<float, 3>>) {
    if (info.form == Form::direction) values = direction_of(field);
  }
}
template <class Value>
void read_key(const json::JsonField& field, const FieldInfo& info, std::vector<Value>& values) {
  values.resize(require_array(field, "an array").size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    Interrupt::poll();
    read_key(child(field, i), info, values[i]);
  }
}
template <class Value>
void read_key(const json::JsonField& field, const FieldInfo& info, std::optional<Value>& value) {
  read_key(field, info, value.emplace());
}
template <class Value, bool kIsRequired, int kAlternative>
void read_key(const json::JsonField& field, const FieldInfo& info, keys::Key<Value, kIsRequired, kAlternative>& key) {
  read_key(field, info, key.value);
}
template <HasFields Object>
void read_key(const json::JsonField& field, const FieldInfo&, Object& object) {
  check_keys<Object>(field);
  for_each_key<Object>([&](const auto& key) {
    if (const auto given = find(field, key.name)) read_key(*given, key.info, object.*(key.member));
  });
}

// Returns an object of a scene file.
template <class Object>
Object read_object(const json::JsonField& field) {
  Object object;
  read_key(field, {}, object);
  return object;
}

}  // namespace flockstep
