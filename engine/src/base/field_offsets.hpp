// Lists the fields of a configuration by offset, for non-template code that accesses them through pointers.
#pragma once

#include <cstddef>
#include <type_traits>
#include <vector>

#include "flockstep/fields.hpp"

namespace flockstep {

// Returns make(name, info, offset, std::type_identity<Value>()) for each field, in declaration order. The offset is in bytes
// from the beginning of the configuration.
template <class Entry, class Config, class Make>
std::vector<Entry> list_fields(const Make& make) {
  static_assert(lists_every_field<Config>());
  const Config config;
  const auto offset_of = [&](const auto& value) {
    return reinterpret_cast<const char*>(&value) - reinterpret_cast<const char*>(&config);
  };
  return kFields<Config>.apply([&]<class... Values>(const FieldPointer<Config, Values>&... fields) {
    return std::vector<Entry>{
        make(fields.name, &fields.info, offset_of(config.*(fields.member)), std::type_identity<Values>())...};
  });
}

}  // namespace flockstep
