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
// Returns a drone model from a model or an argument of DroneModel.load(); None means DroneModel::quadrotor650().
DroneModel drone_argument(const pybind11::object& drone);

}  // namespace flockstep::bindings
