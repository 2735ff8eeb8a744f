// Worlds and drones as arguments: Python passes an object, or its name or path.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>
#include <vector>

#include "flockstep/drone_model.hpp"
#include "flockstep/world.hpp"

namespace flockstep::bindings {

// The worlds that flockstep.scenes.load() returns for an argument called `worlds`.
std::vector<std::shared_ptr<World>> worlds_argument(const pybind11::object& worlds);
// One world. Throws ValueError if the argument stands for several.
std::shared_ptr<World> world_argument(const pybind11::object& world);
// A model, or what DroneModel.load() takes; None is DroneModel::quadrotor650().
DroneModel drone_argument(const pybind11::object& drone);

}  // namespace flockstep::bindings
