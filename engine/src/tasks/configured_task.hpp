// ConfiguredTask: base of the engine's tasks. A task is known by the name and the hash of its configuration.
#pragma once

#include <string>
#include <utility>

#include "base/hash.hpp"
#include "flockstep/task.hpp"
#include "flockstep/task_words.hpp"

namespace flockstep::task {

// Base: Task, or a class between. The constructor of the task completes spec_.
template <class Config, class Base = Task>
class ConfiguredTask : public Base {
 public:
  const TaskSpec& spec() const override { return spec_; }
  std::string identity() const override {
    Hash hash;
    hash.add(config_);
    return Config::kName + (' ' + std::to_string(hash.value()));
  }

 protected:
  ConfiguredTask(const Config& config, Field action) : config_(config) {
    config.validate();
    spec_.action = std::move(action);
    spec_.reward_terms = reward_terms_of<Config>();
  }

  const Config config_;
  TaskSpec spec_;
};

}  // namespace flockstep::task
