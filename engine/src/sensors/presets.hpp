// Configurations of products, by name.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "base/excerpt.hpp"
#include "base/nearest_name.hpp"
#include "base/require.hpp"

namespace flockstep::sensors {

// Returns the preset of this name. Throws std::invalid_argument about `field` that lists the names.
template <class Config, std::size_t kCount>
Config preset_named(std::string_view name, const std::array<Config, kCount>& presets, std::string_view field) {
  std::vector<std::string_view> known;
  std::string expected = "one of";
  for (const Config& preset : presets) {
    if (preset.name == name) return preset;
    known.push_back(preset.name);
    expected += (known.size() == 1 ? " " : ", ") + preset.name;
  }
  refuse(field, expected, quoted_excerpt(name) + did_you_mean(name, known));
}

}  // namespace flockstep::sensors
