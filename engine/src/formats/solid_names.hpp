// Names by which other programs tell what is there for collision alone.
#pragma once

#include <string_view>

namespace flockstep {

// As Unreal and Godot have them.
inline bool is_solid_name(std::string_view name) {
  for (const std::string_view prefix : {"UBX_", "UCP_", "USP_", "UCX_"}) {
    if (name.starts_with(prefix)) return true;
  }
  return name.ends_with("-colonly") || name.ends_with("-convcolonly");
}

}  // namespace flockstep
