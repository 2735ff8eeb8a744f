// The message about a scene that does not exist.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace flockstep {

// Returns a message that suggests up to three of the known names and generators.
std::string unknown_scene(std::string_view name, std::span<const std::string> known);

}  // namespace flockstep
