#include "formats/body_json.hpp"

#include <cstddef>
#include <string>
#include <utility>

#include "base/config_values.hpp"
#include "base/interrupt.hpp"
#include "formats/scene_values.hpp"

namespace flockstep {
namespace {

using OrderedJson = nlohmann::ordered_json;

// Compares as text, because 0 equals -0.
OrderedJson without_defaults(const OrderedJson& object, const OrderedJson& usual) {
  OrderedJson rest = OrderedJson::object();
  for (const auto& [key, value] : object.items()) {
    if (value.dump() == usual[key].dump()) continue;
    rest[key] = value.is_object() ? without_defaults(value, usual[key]) : value;
  }
  return rest;
}

}  // namespace

std::vector<BodyConfig> read_bodies(const json::JsonField& field) {
  const std::size_t count = json::require_array(field, "an array").size();
  if (count > keys::kBodies.most) {
    refuse(field, "at most " + std::to_string(keys::kBodies.most) + ' ' + std::string(keys::kBodies.name), count);
  }
  const std::string list = field.source + ": " + std::string(keys::kBodies.name);
  std::vector<BodyConfig> bodies(count);
  for (std::size_t i = 0; i < count; ++i) {
    Interrupt::poll();
    config_values::read_value(field.value[i], {}, config_values::element(list, i), bodies[i]);
  }
  return bodies;
}

OrderedJson write_bodies(const std::vector<BodyConfig>& bodies) {
  const OrderedJson usual = config_values::written(BodyConfig(), "");
  OrderedJson list = OrderedJson::array();
  for (const BodyConfig& body : bodies) list.push_back(without_defaults(config_values::written(body, ""), usual));
  return list;
}

}  // namespace flockstep
