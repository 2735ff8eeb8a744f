#include "world/scene_keys.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/json_document.hpp"

namespace flockstep {
namespace {

using OrderedJson = nlohmann::ordered_json;

OrderedJson keys_as_json(std::span<const SceneKey> keys);

OrderedJson key_as_json(const SceneKey& key) {
  const auto name_of = [](const auto& names, auto value) { return names[static_cast<std::size_t>(value)]; };
  OrderedJson object = {{"name", key.name}, {"meaning", key.info.about}};
  object["kind"] = key.info.form == Form::direction ? "direction" : name_of(EnumNames<ValueKind>::kNames, key.kind);
  object["count"] = name_of(EnumNames<ValueCount>::kNames, key.count);
  object["size"] = key.size;
  object["unit"] = key.info.unit;
  object["required"] = key.is_required;
  object["alternative"] = key.alternative;
  if (std::isfinite(key.info.limits.least)) object["least"] = key.info.limits.least;
  if (std::isfinite(key.info.limits.greatest)) object["greatest"] = key.info.limits.greatest;
  if (key.info.limits.or_zero) object["or_zero"] = true;
  if (key.kind == ValueKind::version) object["version"] = kSceneVersion;
  if (key.most != 0) object["most"] = key.most;
  if (key.kind == ValueKind::flag) object["default"] = true;
  if (key.usual != nullptr) object["default"] = OrderedJson::parse(key.usual());
  if (!key.choices.empty()) object["choices"] = std::vector<std::string>(key.choices.begin(), key.choices.end());
  if (!key.keys.empty()) object["keys"] = keys_as_json(key.keys);
  return object;
}

OrderedJson keys_as_json(std::span<const SceneKey> keys) {
  OrderedJson list = OrderedJson::array();
  for (const SceneKey& key : keys) list.push_back(key_as_json(key));
  return list;
}

}  // namespace

std::string scene_keys_as_json() { return keys_as_json(keys::kSceneKeys).dump(); }

std::string text_of_values(const SceneKey& key) {
  return (key.info.limits.or_zero ? "0 or " : "") + std::string(key.size == 0 ? "a number " : "numbers ") +
         key.info.limits.text();
}

}  // namespace flockstep
