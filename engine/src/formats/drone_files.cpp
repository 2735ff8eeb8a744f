#include <string>
#include <string_view>
#include <vector>

#include "base/excerpt.hpp"
#include "base/nearest_name.hpp"
#include "base/require.hpp"
#include "base/text_file.hpp"
#include "flockstep/drone_model.hpp"
#include "formats/drone_json.hpp"

namespace flockstep {
namespace {

// The bundled airframes: name and text of each file in drones/, sorted by name.
struct Bundled {
  std::string_view name, text;
};
constexpr Bundled kBundled[] = {
#include "drones.inc"
};

}  // namespace

DroneModel DroneModel::quadrotor650() { return load("t650"); }

DroneModel DroneModel::load(const std::string& name_or_path) {
  if (name_or_path.ends_with(".json")) return read_drone(read_text_file(name_or_path, "a drone file"), name_or_path);
  std::string names;
  std::vector<std::string_view> known;
  for (const auto& [name, text] : kBundled) {
    if (name == name_or_path) return read_drone(std::string(text), "drone " + name_or_path);
    names += (names.empty() ? "" : ", ") + std::string(name);
    known.push_back(name);
  }
  refuse("drone", "one of " + names + ", or the path of a file ending in .json",
         quoted_excerpt(name_or_path) + did_you_mean(name_or_path, known));
}

DroneModel DroneModel::from_json(const std::string& text) { return read_drone(text, "drone"); }

std::vector<std::string> DroneModel::names() {
  std::vector<std::string> names;
  for (const auto& [name, text] : kBundled) names.emplace_back(name);
  return names;
}

std::string DroneModel::to_json() const { return write_drone(*this); }

}  // namespace flockstep
