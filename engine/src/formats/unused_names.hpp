// Names that are all different, for materials and textures of files that repeat theirs.
#pragma once

#include <cstddef>
#include <map>
#include <set>
#include <string>

namespace flockstep {

class UnusedNames {
 public:
  // The wanted name, which is used from now on, or one with a number behind it where it has been used before.
  std::string take(const std::string& wanted) {
    std::string name = wanted;
    for (std::size_t& number = numbers_.try_emplace(wanted, 1).first->second; !used_.insert(name).second;) {
      name = wanted + ' ' + std::to_string(++number);
    }
    return name;
  }

 private:
  std::set<std::string> used_;
  std::map<std::string, std::size_t> numbers_;  // the last suffix of each
};

}  // namespace flockstep
