// The TaskContext of a batch, the interface that its task uses.
#pragma once

#include <memory>

#include "flockstep/task.hpp"

namespace flockstep {

struct Simulation;

std::unique_ptr<TaskContext> make_task_context(Simulation& sim);

}  // namespace flockstep
