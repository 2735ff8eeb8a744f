// preset_named: the preset of a sensor by the name of a product.
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

// Returns the preset with this name. Throws std::invalid_argument that lists the names; callee: the function in its message.
template <class Config, std::size_t kCount>
const Config& preset_named(std::string_view product, const std::array<Config, kCount>& presets, std::string_view callee) {
  std::vector<std::string_view> known;
  std::string expected = "one of";
  for (const Config& preset : presets) {
    if (preset.name == product) return preset;
    known.push_back(preset.name);
    expected += (known.size() == 1 ? " " : ", ") + preset.name;
  }
  refuse(callee, expected, quoted_excerpt(product) + did_you_mean(product, known));
}

}  // namespace flockstep::sensors
