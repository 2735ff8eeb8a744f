// Words about a task, from which its environment's page, help() and the stub are made, and how its pictures look.
#pragma once

#include <string>
#include <vector>

namespace flockstep {

// A part of the observation, or a term of the reward.
struct TaskPart {
  const char* name;   // how many numbers; or the term's name
  const char* about;  // what they are, with their unit; or the term's value
};

// Full sentences, with names and values in double backquotes; view and overlay are names.
struct TaskWords {
  const char* about;                  // what the drone must do, after the sentence kAbout
  const char* start;                  // how an episode begins
  const char* action;                 // meaning and limits of an action
  const char* observed;               // frame and units of the observation
  std::vector<TaskPart> observation;  // in order
  std::vector<TaskPart> reward;       // in the order of TaskSpec::reward_terms
  const char* end;                    // how an episode ends, and when it is a success
  const char* view = "top";           // view of its pictures, unless another is chosen
  const char* overlay = "";           // what they show of it: one of OVERLAYS in envs/flockstep/pictures; empty: nothing
};

// Returns the names of a task's reward terms.
template <class Config>
std::vector<std::string> reward_terms_of() {
  std::vector<std::string> names;
  for (const TaskPart& term : Config::words().reward) names.emplace_back(term.name);
  return names;
}

}  // namespace flockstep
