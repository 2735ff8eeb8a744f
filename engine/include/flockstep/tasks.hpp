// The tasks of the engine: TaskConfig, the list of their configurations.
#pragma once

#include <memory>
#include <string>
#include <type_traits>
#include <variant>

#include "flockstep/tasks/dodge.hpp"
#include "flockstep/tasks/formation.hpp"
#include "flockstep/tasks/hover.hpp"
#include "flockstep/tasks/navigation.hpp"
#include "flockstep/tasks/race.hpp"
#include "flockstep/tasks/swap.hpp"
#include "flockstep/tasks/track.hpp"

namespace flockstep {

// A task that another program registered under this id, for example in Python. The engine cannot make it.
struct RegisteredTask {
  std::string id;  // name of the task in that program
};

// Each configuration needs its own make_task. Without this deleted template, the make_task of TaskConfig in recipe.hpp would
// call itself for a configuration that has none.
template <class Config>
std::unique_ptr<Task> make_task(const Config& config) = delete;

// All tasks of the engine, plus std::monostate for none, and RegisteredTask. Recipes, and in Python classes, keywords,
// environments and their pages are made from this list. A configuration has a name for recipes (kName), a sentence (kAbout),
// words(), fields() and make_task(), and observing() if other defaults depend on its observation.
using TaskConfig = std::variant<std::monostate, NavigationConfig, HoverConfig, TrackConfig, RaceConfig, DodgeConfig, SwapConfig,
                                FormationConfig, RegisteredTask>;

// True for the configuration of a task of the engine.
template <class Config>
inline constexpr bool kIsEngineTask = !std::is_same_v<Config, std::monostate> && !std::is_same_v<Config, RegisteredTask>;

// Calls visit(std::type_identity<Config>()) for each task of the engine, in the order of the list.
template <class Visit>
constexpr void for_each_task(const Visit& visit) {
  const auto visit_one = [&]<class Config>(std::type_identity<Config> type) {
    if constexpr (kIsEngineTask<Config>) visit(type);
  };
  [&]<class... Configs>(std::type_identity<std::variant<Configs...>>) {
    (visit_one(std::type_identity<Configs>()), ...);
  }(std::type_identity<TaskConfig>());
}

}  // namespace flockstep
