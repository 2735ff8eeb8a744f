// Makes names of materials and textures unique for files that repeat them.
#pragma once

#include <cstddef>
#include <map>
#include <set>
#include <string>

namespace flockstep {

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
