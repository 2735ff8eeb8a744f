// FormationPath: a planned route through a world, and how much of a formation's shape has room along it.
#pragma once

#include <vector>

#include "flockstep/drone_model.hpp"
#include "flockstep/world.hpp"
#include "tasks/leader.hpp"

namespace flockstep::task {

class FormationPath {
 public:
  // Plans the path from the start marker over the waypoints to the goal, with some room around the drone. Throws
  // std::invalid_argument if there is none, or none that is longer than the column.
  FormationPath(const World& world, const DroneModel& drone, const FormationPlaces& places, float spacing_m);

  LeaderRoute route() const;
  double first() const { return first_; }  // m, way of the leader when the last place of the column is at the start
  double last() const { return last_; }    // m, its way when the first place of the column is at the goal
  // Share of the shape at a way of the leader, in [0, 1].
  double share(double way) const;

 private:
  std::vector<float> corners_;  // (K, 3) m
  double reach_ = 0.0;          // m, before and after the leader, between which its heading leads
  double first_ = 0.0, last_ = 0.0;
  std::vector<double> shares_;  // from first_ on, one for each step
};

}  // namespace flockstep::task
