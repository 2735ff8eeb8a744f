// fly_to_goal.cpp: an external C++ task: fly to the goal marker without touching anything.
//
// docs/how-to/tasks/task-in-cpp.md explains how to build and fly it.
#include <stdexcept>

#include "flockstep/task.hpp"

using namespace flockstep;

class FlyToGoal final : public Task {
 public:
  FlyToGoal() : spec_{.action = {.name = "action", .shape = {3}}, .reward_terms = {"closer", "arrived", "crashed"}} {
    spec_.observation = {{.name = "direction", .shape = {3}}};  // float32 in [-1, 1] by default, like the action
  }
  const TaskSpec& spec() const override { return spec_; }
  std::string identity() const override { return "FlyToGoal 1"; }  // name and configuration

  void setup(const TaskContext& context) override {
    for (const auto& world : context.worlds()) {
      if (!world->markers().goal) throw std::invalid_argument("worlds: expected worlds with a goal, got " + world->name());
    }
    last_distance_.resize(context.num_drones());
  }
  void begin(const TaskBlock& block) override {
    for (const auto drone : block.drones) last_distance_[drone] = to_goal(block, drone).norm();
  }
  void command(const TaskBlock& block, const Buffer& actions, Setpoints& setpoints) override {
    for (const auto drone : block.drones) {
      const Vec3 action = Vec3(actions.row<float>(drone).data()).cwiseMax(-1.0F).cwiseMin(1.0F);
      setpoints.target[drone] = {position_of(block.context.state(), drone) + 0.1F * action, Quat::Identity()};
    }
  }
  void score(const TaskBlock& block, Score& score) override {
    for (const auto drone : block.drones) {
      const float distance = to_goal(block, drone).norm();
      const bool crashed = block.context.state().contact.hit[drone] != 0;
      score.success[drone] = distance < 0.5F && !crashed;
      score.terminated[drone] = score.success[drone] || crashed;
      const auto terms = score.terms_of(drone);
      terms[0] = last_distance_[drone] - distance;
      terms[1] = score.success[drone] ? 10.0 : 0.0;
      terms[2] = crashed ? -10.0 : 0.0;
      last_distance_[drone] = distance;
    }
  }
  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    for (const auto drone : block.drones) {
      Eigen::Map<Vec3>(observation[0].row<float>(drone).data()) = to_goal(block, drone).stableNormalized();
    }
  }
  void visit(ArrayVisitor& visitor) override { visitor.array("last_distance", last_distance_); }  // for snapshots

 private:
  static Vec3 to_goal(const TaskBlock& block, DroneIndex drone) {
    return *block.context.world_of(block.context.env_of(drone)).markers().goal - position_of(block.context.state(), drone);
  }

  TaskSpec spec_;
  std::vector<float> last_distance_;  // (N,) m
};

FLOCKSTEP_EXPORT_TASK(FlyToGoal)
