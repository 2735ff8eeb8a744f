// Recognizes names that other programs use for collision-only objects.
#pragma once

#include <string_view>

namespace flockstep {

// Conventions of Unreal and Godot.
inline bool is_solid_name(std::string_view name) {
  for (const std::string_view prefix : {"UBX_", "UCP_", "USP_", "UCX_"}) {
    if (name.starts_with(prefix)) return true;
  }
  return name.ends_with("-colonly") || name.ends_with("-convcolonly");
}

}  // namespace flockstep
