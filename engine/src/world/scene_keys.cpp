#include "world/scene_keys.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "base/config_values.hpp"

namespace flockstep {
namespace {

using OrderedJson = nlohmann::ordered_json;

template <class Object>
OrderedJson keys_of();

// Names what a single value is.
template <class Value>
constexpr const char* kind_of() {
  if constexpr (std::is_same_v<Value, keys::Unread>) return "anything";
  if constexpr (std::is_same_v<Value, keys::Version>) return "version";
  if constexpr (std::is_same_v<Value, keys::Text> || std::is_same_v<Value, std::string>) return "text";
  if constexpr (std::is_same_v<Value, keys::TextOrTexts>) return "text_or_texts";
  if constexpr (std::is_same_v<Value, bool>) return "flag";
  if constexpr (std::is_same_v<Value, keys::Index>) return "index";
  if constexpr (std::is_floating_point_v<Value>) return "number";
  if constexpr (std::is_integral_v<Value>) return "integer";
  if constexpr (std::is_enum_v<Value>) return "choice";
  if constexpr (std::is_same_v<Value, BodyConfig>) return "config";  // docs/reference/configs.md lists the fields
  return "object";
}

template <class Value>
constexpr bool kHasDefault = std::is_arithmetic_v<Value> || std::is_enum_v<Value> || std::is_same_v<Value, std::string>;
template <class Value, std::size_t kSize>
constexpr bool kHasDefault<std::array<Value, kSize>> = kHasDefault<Value>;

// The part of a key that the type of its member gives: a constant, because code that writes JSON is large and must not be a
// template.
struct KeyType {
  const char* kind = "";
  const char* count = "one";
  std::size_t size = 0;  // of an array; 0: a single value
  std::size_t most = 0;  // 0: any number
  bool is_required = false;
  int alternative = 0;
  bool is_version = false;
  std::span<const char* const> choices{};
  OrderedJson (*keys)() = nullptr;  // an object's
};

template <class Value>
constexpr KeyType key_type(const Value*) {
  KeyType type{.kind = kind_of<Value>(), .is_version = std::is_same_v<Value, keys::Version>};
  if constexpr (std::is_enum_v<Value>) type.choices = EnumNames<Value>::kNames;
  if constexpr (HasFields<Value> && !std::is_same_v<Value, BodyConfig>) type.keys = keys_of<Value>;
  return type;
}
template <class Value, std::size_t kSize>
constexpr KeyType key_type(const std::array<Value, kSize>*) {
  KeyType type = key_type(static_cast<const Value*>(nullptr));
  type.size = kSize;
  return type;
}
template <class Value>
constexpr KeyType key_type(const std::optional<Value>*) {
  return key_type(static_cast<const Value*>(nullptr));
}
template <class Value, std::size_t kMost, bool kAreNamed>
constexpr KeyType key_type(const keys::List<Value, kMost, kAreNamed>*) {
  KeyType type = key_type(static_cast<const Value*>(nullptr));
  type.count = kAreNamed ? "by_name" : "list";
  type.most = kMost;
  return type;
}
template <class Value>
constexpr KeyType key_type(const std::vector<Value>*) {
  return key_type(static_cast<const keys::List<Value>*>(nullptr));
}
template <class Value, bool kIsRequired, int kAlternative>
constexpr KeyType key_type(const keys::Key<Value, kIsRequired, kAlternative>*) {
  KeyType type = key_type(static_cast<const Value*>(nullptr));
  type.is_required = kIsRequired;
  type.alternative = kAlternative;
  return type;
}

OrderedJson described(const char* name, const FieldInfo& info, const KeyType& type) {
  OrderedJson key{{"name", name},
                  {"meaning", info.about},
                  {"count", type.count},
                  {"size", type.size},
                  {"unit", info.unit},
                  {"required", type.is_required},
                  {"alternative", type.alternative}};
  if (std::isfinite(info.limits.least)) key["least"] = info.limits.least;
  if (std::isfinite(info.limits.greatest)) key["greatest"] = info.limits.greatest;
  if (info.limits.or_zero) key["or_zero"] = true;
  if (type.most != 0) key["most"] = type.most;
  key["kind"] = info.form == Form::direction ? "direction" : type.kind;
  if (type.is_version) key["version"] = kSceneVersion;
  for (const char* const choice : type.choices) key["choices"].push_back(choice);
  if (type.keys != nullptr) key["keys"] = type.keys();
  return key;
}

template <class Object>
OrderedJson keys_of() {
  OrderedJson list = OrderedJson::array();
  for_each_key<Object>([&]<class Struct, class Value>(const FieldPointer<Struct, Value>& field) {
    list.push_back(described(field.name, field.info, key_type(static_cast<const Value*>(nullptr))));
    if constexpr (kHasDefault<Value>) list.back()["default"] = config_values::written(Object().*(field.member), "");
  });
  return list;
}

}  // namespace

std::string scene_keys_as_json() { return keys_of<keys::Scene>().dump(); }

}  // namespace flockstep
