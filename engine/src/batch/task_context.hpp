// The TaskContext of a batch, the interface that its task uses.
#pragma once

#include <memory>
#include <optional>

#include "flockstep/task.hpp"

namespace flockstep {

struct Simulation;

// Returns whether a drone of an env would touch nothing at a pose: neither the world nor a body nor, if drones touch, another
// drone that has its place. drone: none if it is a new one.
bool touches_nothing(const Simulation& sim, EnvIndex env, std::optional<DroneIndex> drone, const Pose& pose);

std::unique_ptr<TaskContext> make_task_context(Simulation& sim);

}  // namespace flockstep
