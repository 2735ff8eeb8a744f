// An external task: rise to 2 m above the start. It needs only these headers. Build it as a shared library,
//   c++ -std=c++20 -O2 -shared -fPIC -I<include_dir()> $(pkg-config --cflags eigen3) reach_height.cpp -o reach_height.so
// and pass that to flockstep.register_task(). Each env has one drone, therefore env and drone have the same index.
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "flockstep/task.hpp"

class ReachHeight final : public flockstep::Task {
 public:
  ReachHeight() {
    constexpr double kAny = std::numeric_limits<double>::infinity();
    spec_.action = {.name = "displacement", .shape = {3}};                                   // in units of 0.25 m
    spec_.observation = {{.name = "height", .shape = {2}, .low = {-kAny}, .high = {kAny}}};  // m: way to the target, height
    spec_.reward_terms = {"closer", "arrived"};
  }

  const flockstep::TaskSpec& spec() const override { return spec_; }
  flockstep::TaskDefaults defaults() const override { return {.worlds = "train", .max_episode_steps = 200}; }
  std::string identity() const override { return "reach height"; }

  void setup(const flockstep::TaskContext& context) override {
    target_.resize(context.num_drones());
    last_.resize(context.num_drones());
  }
  void begin(const flockstep::TaskBlock& block) override {
    for (const flockstep::DroneIndex drone : block.drones) {
      last_[drone] = position_of(block.context.state(), drone).z();
      target_[drone] = last_[drone] + 2.0F;
    }
  }
  void command(const flockstep::TaskBlock& block, const flockstep::Buffer& actions, flockstep::Setpoints& setpoints) override {
    for (const flockstep::DroneIndex drone : block.drones) {
      const flockstep::Vec3 from = position_of(block.context.state(), drone);
      const flockstep::Vec3 step = flockstep::Vec3(actions.row<float>(drone).data()).cwiseMax(-1.0F).cwiseMin(1.0F);
      setpoints.target[drone] = {from + 0.25F * step, flockstep::Quat::Identity()};
    }
  }
  void score(const flockstep::TaskBlock& block, flockstep::Score& score) override {
    for (const flockstep::DroneIndex drone : block.drones) {
      const float height = position_of(block.context.state(), drone).z();
      const float off = std::abs(target_[drone] - height);
      const bool touched = block.context.state().contact.hit[drone] != 0;
      score.success[drone] = !touched && off <= 0.1F;
      score.terminated[drone] = touched || score.success[drone];
      const std::span<double> terms = score.terms_of(drone);
      terms[0] = std::abs(target_[drone] - last_[drone]) - off;
      terms[1] = score.success[drone];
      last_[drone] = height;
    }
  }
  void observe(const flockstep::TaskBlock& block, std::span<flockstep::Buffer> observation) override {
    for (const flockstep::DroneIndex drone : block.drones) {
      const float height = block.context.sensed_pose(drone).position.z();
      observation[0].row<float>(drone)[0] = target_[drone] - height;
      observation[0].row<float>(drone)[1] = height;
    }
  }
  void visit(flockstep::ArrayVisitor& visitor) override { visitor.array("target", target_), visitor.array("last", last_); }

 private:
  flockstep::TaskSpec spec_;
  std::vector<float> target_, last_;  // (N,) m, target heights and heights after the previous step
};

FLOCKSTEP_EXPORT_TASK(ReachHeight)
