// Converts arguments for worlds and drones: Python passes an object, a name or a path.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>
#include <vector>

#include "flockstep/drone_model.hpp"
#include "flockstep/world.hpp"

namespace flockstep::bindings {

// Returns the worlds that flockstep.scenes.load() gives for an argument called `worlds`.
std::vector<std::shared_ptr<World>> worlds_argument(const pybind11::object& worlds);
// Returns a single world. Throws ValueError if the argument stands for several.
std::shared_ptr<World> world_argument(const pybind11::object& world);
// Returns the keywords that are not None. Throws TypeError for one that is not a field of Light.
pybind11::kwargs light_changes(const pybind11::kwargs& keywords, const char* callee);
// Returns the lighting of a world with some changes; tint: None, one colour for all materials, or one per material.
Lighting lighting_argument(const World& world, const pybind11::kwargs& changes, const pybind11::object& tint);
// Returns a drone model from a model or an argument of DroneModel.load(); None means DroneModel::quadrotor650().
DroneModel drone_argument(const pybind11::object& drone);

}  // namespace flockstep::bindings
