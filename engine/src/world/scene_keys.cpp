#include "world/scene_keys.hpp"

#include <cmath>
#include <nlohmann/json.hpp>
#include <type_traits>

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

// Adds what the type of a member says of its key.
template <class Value>
void describe(OrderedJson& key, const Value*) {
  key["kind"] = kind_of<Value>();
  if constexpr (std::is_same_v<Value, keys::Version>) key["version"] = kSceneVersion;
  if constexpr (std::is_enum_v<Value>) key["choices"] = EnumNames<Value>::kNames;
  if constexpr (HasFields<Value> && !std::is_same_v<Value, BodyConfig>) key["keys"] = keys_of<Value>();
}
template <class Value, std::size_t kSize>
void describe(OrderedJson& key, const std::array<Value, kSize>*) {
  key["size"] = kSize;
  describe(key, static_cast<const Value*>(nullptr));
}
template <class Value>
void describe(OrderedJson& key, const std::optional<Value>*) {
  describe(key, static_cast<const Value*>(nullptr));
}
template <class Value, std::size_t kMost, bool kAreNamed>
void describe(OrderedJson& key, const keys::List<Value, kMost, kAreNamed>*) {
  key["count"] = kAreNamed ? "by_name" : "list";
  if (kMost != 0) key["most"] = kMost;
  describe(key, static_cast<const Value*>(nullptr));
}
template <class Value>
void describe(OrderedJson& key, const std::vector<Value>*) {
  describe(key, static_cast<const keys::List<Value>*>(nullptr));
}
template <class Value, bool kIsRequired, int kAlternative>
void describe(OrderedJson& key, const keys::Key<Value, kIsRequired, kAlternative>*) {
  key["required"] = kIsRequired;
  key["alternative"] = kAlternative;
  describe(key, static_cast<const Value*>(nullptr));
}

template <class Object>
OrderedJson keys_of() {
  OrderedJson list = OrderedJson::array();
  for_each_key<Object>([&]<class Struct, class Value>(const FieldPointer<Struct, Value>& field) {
    const FieldInfo& info = field.info;
    OrderedJson& key = list.emplace_back();
    key = {{"name", field.name}, {"meaning", info.about}, {"count", "one"},  {"size", 0},
           {"unit", info.unit},  {"required", false},     {"alternative", 0}};
    if (std::isfinite(info.limits.least)) key["least"] = info.limits.least;
    if (std::isfinite(info.limits.greatest)) key["greatest"] = info.limits.greatest;
    if (info.limits.or_zero) key["or_zero"] = true;
    describe(key, static_cast<const Value*>(nullptr));
    if (info.form == Form::direction) key["kind"] = "direction";
    if constexpr (kHasDefault<Value>) key["default"] = config_values::written(Object().*(field.member), "");
  });
  return list;
}

}  // namespace

std::string scene_keys_as_json() { return keys_of<keys::Scene>().dump(); }

}  // namespace flockstep
