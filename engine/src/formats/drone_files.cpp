// Reads and writes drone files: DroneModels as the JSON that docs/reference/drone-files.md describes.
#include <array>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "base/config_values.hpp"
#include "base/excerpt.hpp"
#include "base/json_document.hpp"
#include "base/nearest_name.hpp"
#include "base/require.hpp"
#include "base/text_file.hpp"
#include "flockstep/drone_model.hpp"
#include "world/random_drone.hpp"

namespace flockstep {
namespace {

using json::JsonField;
using OrderedJson = nlohmann::ordered_json;
using Triple = Airframe::Triple;

constexpr int kDroneVersion = 1;
constexpr const char* kDroneKey = "flockstep_drone";

// Airframe::validate() checks the ranges of the numbers.
template <class Value>
Value read(const JsonField& field) {
  Value value{};
  config_values::read_value(field, {}, value);
  return value;
}
template <class Value>
void read_to(Value& value, const JsonField& object, const char* key) {
  if (const auto field = find(object, key)) value = read<Value>(*field);
}

// Requires the keys of a frame that is not based on another one.
void require_all(const JsonField& object, std::initializer_list<const char*> keys) {
  for (const char* const key : keys) require(object, key);
}

void read_rotors(const JsonField& field, Airframe& frame, bool is_new) {
  check_object(field, {"position_m", "spin", "thrust_n", "max_thrust_n", "max_speed_radps", "min_speed_radps", "torque_ratio_m",
                       "lag_s", "lag_up_s", "lag_down_s", "radius_m", "inertia_kgm2", "drag_n_per_radps_mps", "lift_n_per_mps2"});
  if (is_new) require_all(field, {"position_m", "spin", "max_speed_radps", "torque_ratio_m"});
  read_to(frame.position_m, field, "position_m");
  read_to(frame.spin, field, "spin");
  read_to(frame.max_speed_radps, field, "max_speed_radps");
  read_to(frame.min_speed_radps, field, "min_speed_radps");
  const auto thrust = find(field, "thrust_n");
  const auto max_thrust = find(field, "max_thrust_n");
  if (thrust && max_thrust) fail(field, "expected either \"thrust_n\" or \"max_thrust_n\", found both");
  if (is_new && !thrust && !max_thrust) fail(field, "expected a field \"thrust_n\" or \"max_thrust_n\", found none");
  if (thrust) frame.thrust_n = read<Triple>(*thrust);
  if (max_thrust) frame.thrust_n = {0.0, 0.0, read<double>(*max_thrust) / (frame.max_speed_radps * frame.max_speed_radps)};
  read_to(frame.torque_ratio_m, field, "torque_ratio_m");
  if (const auto lag = find(field, "lag_s")) frame.lag_up_s = frame.lag_down_s = read<double>(*lag);
  read_to(frame.lag_up_s, field, "lag_up_s");
  read_to(frame.lag_down_s, field, "lag_down_s");
  read_to(frame.radius_m, field, "radius_m");
  read_to(frame.rotor_inertia_kgm2, field, "inertia_kgm2");
  read_to(frame.rotor_drag, field, "drag_n_per_radps_mps");
  read_to(frame.rotor_lift, field, "lift_n_per_mps2");
}

// Returns a box around the origin as an eight-sided prism: its upright edges are cut off by a quarter of each side.
std::vector<Vec3> prism(const Triple& size) {
  std::vector<Vec3> hull;
  for (const double z : {-0.5, 0.5}) {
    for (const double y : {-1.0, 1.0}) {
      for (const double x : {-1.0, 1.0}) {
        hull.push_back(Eigen::Vector3d(0.5 * x * size[0], 0.25 * y * size[1], z * size[2]).cast<float>());
        hull.push_back(Eigen::Vector3d(0.25 * x * size[0], 0.5 * y * size[1], z * size[2]).cast<float>());
      }
    }
  }
  return hull;
}

// Returns the hull of the file, or else that of `like`.
std::vector<Vec3> read_hull(const JsonField& root, const std::optional<DroneModel>& like) {
  const auto size = find(root, "size_m");
  const auto points = find(root, "hull_m");
  if (size && points) fail(root, "expected either \"size_m\" or \"hull_m\", found both");
  if (!size && !points && like) return {like->hull().begin(), like->hull().end()};
  if (!points) {
    const JsonField given = require(root, "size_m");
    const Triple extents = read<Triple>(given);
    for (const double side : extents) {
      if (!(side > 0.0)) refuse(given, "sizes > 0");
    }
    return prism(extents);
  }
  std::vector<Vec3> hull;
  const std::size_t count = require_array(*points, "an array of points (x, y, z)").size();
  if (count > static_cast<std::size_t>(kMaxHullVertices)) refuse(*points, "at most 32 points", count);
  for (std::size_t i = 0; i < count; ++i) {
    const Triple p = read<Triple>(child(*points, i));
    hull.push_back(Eigen::Vector3d(p[0], p[1], p[2]).cast<float>());
  }
  return hull;
}

std::optional<DroneModel> read_like(const JsonField& root) {
  const auto like = find(root, "like");
  const auto scaled = find(root, "scaled");
  if (!like) {
    if (scaled) fail(*scaled, "allowed only beside \"like\", which it scales");
    return std::nullopt;
  }
  const std::string name = text(*like);
  if (name.ends_with(".json")) refuse(*like, "the name of a bundled airframe");
  DroneModel model = DroneModel::load(name);
  if (!scaled) return model;
  check_object(*scaled, {"size", "mass"});
  double size = 1.0;
  double mass = 1.0;
  read_to(size, *scaled, "size");
  read_to(mass, *scaled, "mass");
  return model.scaled(size, mass);
}

std::optional<Airframe> read_airframe(const JsonField& root, const std::optional<DroneModel>& like) {
  const bool is_new = !like || !like->airframe();
  const auto has = [&](const char* key) { return find(root, key).has_value(); };
  if (is_new && !has("mass_kg") && !has("inertia_kgm2") && !has("rotors") && !has("drag")) return std::nullopt;  // only a hull
  Airframe frame = is_new ? Airframe() : *like->airframe();
  if (is_new) require_all(root, {"mass_kg", "inertia_kgm2", "rotors"});
  read_to(frame.mass_kg, root, "mass_kg");
  read_to(frame.inertia_kgm2, root, "inertia_kgm2");
  if (const auto rotors = find(root, "rotors")) read_rotors(*rotors, frame, is_new);
  if (const auto drag = find(root, "drag")) {
    check_object(*drag, {"linear_n_per_mps", "quadratic_n_per_mps2"});
    read_to(frame.linear_drag, *drag, "linear_n_per_mps");
    read_to(frame.quadratic_drag, *drag, "quadratic_n_per_mps2");
  }
  return frame;
}

// Throws std::invalid_argument with the source, the path of the offending field, the expected value and the actual one.
DroneModel read_drone(const std::string& text, const std::string& source) {
  const auto document = json::Document::parse(text, source);
  const JsonField root = document->root();
  check_version(root, kDroneKey, kDroneVersion);
  check_object(root, {kDroneKey, "name", "description", "sources", "disputed", "like", "scaled", "mass_kg", "inertia_kgm2",
                      "size_m", "hull_m", "rotors", "drag"});
  require(root, kDroneKey);
  const auto name = find(root, "name");
  const std::optional<DroneModel> like = read_like(root);
  try {
    return DroneModel(read_hull(root, like), read_airframe(root, like), name ? json::text(*name) : std::string());
  } catch (const std::invalid_argument& error) {
    const std::string what = error.what();
    if (what.starts_with(source)) throw;
    throw std::invalid_argument(source + ": " + what);
  }
}

// Writes every number such that it reads back equal.
std::string write_drone(const DroneModel& drone) {
  OrderedJson root = {{kDroneKey, kDroneVersion}};
  if (!drone.name().empty()) root["name"] = drone.name();
  OrderedJson& hull = root["hull_m"] = OrderedJson::array();
  for (const Vec3& p : drone.hull()) hull.push_back({json::shortest(p.x()), json::shortest(p.y()), json::shortest(p.z())});
  if (const auto& frame = drone.airframe()) {
    root["mass_kg"] = frame->mass_kg;
    root["inertia_kgm2"] = frame->inertia_kgm2;
    root["rotors"] = {{"position_m", frame->position_m},
                      {"spin", config_values::written(frame->spin, "")},
                      {"thrust_n", frame->thrust_n},
                      {"max_speed_radps", frame->max_speed_radps},
                      {"min_speed_radps", frame->min_speed_radps},
                      {"torque_ratio_m", frame->torque_ratio_m},
                      {"lag_up_s", frame->lag_up_s},
                      {"lag_down_s", frame->lag_down_s},
                      {"radius_m", frame->radius_m},
                      {"inertia_kgm2", frame->rotor_inertia_kgm2},
                      {"drag_n_per_radps_mps", frame->rotor_drag},
                      {"lift_n_per_mps2", frame->rotor_lift}};
    root["drag"] = {{"linear_n_per_mps", frame->linear_drag}, {"quadratic_n_per_mps2", frame->quadratic_drag}};
  }
  return root.dump(1) + '\n';
}

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
  if (name_or_path.starts_with(kRandomDrone)) {
    const std::string_view digits = std::string_view(name_or_path).substr(kRandomDrone.size());
    std::uint64_t seed = 0;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), seed);
    require(error == std::errc() && end == digits.data() + digits.size(), "drone", "random/seed-N with an integer N >= 0",
            quoted_excerpt(name_or_path));
    return random_drone(seed);
  }
  std::string names;
  std::vector<std::string_view> known;
  for (const auto& [name, text] : kBundled) {
    if (name == name_or_path) return read_drone(std::string(text), "drone " + name_or_path);
    names += (names.empty() ? "" : ", ") + std::string(name);
    known.push_back(name);
  }
  refuse("drone", "one of " + names + ", random/seed-N, or the path of a file ending in .json",
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
