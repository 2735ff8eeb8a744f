// Converts arguments for worlds and drones: Python passes an object, a name or a path.
#pragma once

#include <pybind11/pybind11.h>

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "flockstep/drone_model.hpp"
#include "flockstep/world.hpp"

namespace flockstep::bindings {

// Returns the worlds that flockstep.scenes.load() gives for an argument called `worlds`.
std::vector<std::shared_ptr<World>> worlds_argument(const pybind11::object& worlds);
// Returns a single world. Throws ValueError if the argument stands for several.
std::shared_ptr<World> world_argument(const pybind11::object& world);
using ColorArgument = std::optional<std::array<float, 3>>;
// Returns the lighting of a world with some changes; nothing leaves a value unchanged. tint: None, one colour for all materials,
// or one per material.
Lighting lighting_argument(const World& world, const ColorArgument& sun_direction, const ColorArgument& sun_color,
                           const ColorArgument& sky_ambient, const ColorArgument& ground_ambient,
                           const ColorArgument& zenith_color, const ColorArgument& horizon_color,
                           const std::optional<float>& gamma, const std::optional<float>& sun_radius_deg,
                           const std::optional<float>& sun_glow, const std::optional<float>& fog_visibility_m,
                           const pybind11::object& tint);
// Returns a drone model from a model or an argument of DroneModel.load(); None means DroneModel::quadrotor650().
DroneModel drone_argument(const pybind11::object& drone);

}  // namespace flockstep::bindings
