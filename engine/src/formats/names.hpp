// Names in the files of other programs.
#pragma once

#include <cstddef>
#include <map>
#include <set>
#include <string>
#include <string_view>

namespace flockstep {

// Recognizes names of collision-only objects, by the conventions of Unreal and Godot.
inline bool is_solid_name(std::string_view name) {
  for (const std::string_view prefix : {"UBX_", "UCP_", "USP_", "UCX_"}) {
    if (name.starts_with(prefix)) return true;
  }
  return name.ends_with("-colonly") || name.ends_with("-convcolonly");
}

// Makes names of materials and textures unique for files that repeat them.
class UnusedNames {
 public:
  // Returns the wanted name, with a number appended if it is already in use, and marks the result as used.
  std::string take(const std::string& wanted) {
    std::string name = wanted;
    for (std::size_t& number = numbers_.try_emplace(wanted, 1).first->second; !used_.insert(name).second;) {
      name = wanted + ' ' + std::to_string(++number);
    }
    return name;
  }

 private:
  std::set<std::string> used_;
  std::map<std::string, std::size_t> numbers_;  // last suffix of each
};

}  // namespace flockstep
