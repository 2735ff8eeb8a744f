// Checks that a batch makes on the specification and names of any task.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "batch_helpers.hpp"
#include "flockstep/batch.hpp"

namespace flockstep {
namespace {

using testing::primitive;

// A task that stands still, observes nothing, and has an array with the same name as one of the batch's.
class Still final : public Task {
 public:
  explicit Still(TaskSpec spec) : spec_(std::move(spec)) {}

  const TaskSpec& spec() const override { return spec_; }
  std::string identity() const override { return "still"; }
  void setup(const TaskContext&) override {}
  void begin(const TaskBlock&) override {}
  void command(const TaskBlock& block, const Buffer&, Setpoints& setpoints) override {
    for (const DroneIndex drone : block.drones) setpoints.target[drone] = pose_of(block.context.state(), drone);
  }
  void score(const TaskBlock& block, Score& score) override {
    for (const DroneIndex drone : block.drones) {
      for (double& term : score.terms_of(drone)) term = 0.0;
      score.terminated[drone] = score.success[drone] = 0;
    }
  }
  void observe(const TaskBlock&, std::span<Buffer>) override {}
  void visit(ArrayVisitor& visitor) override { visitor.array("world_index", odd_); }

  std::vector<std::uint8_t> odd_ = {255, 255, 255};  // not valid indices, and not a multiple of four bytes

 private:
  TaskSpec spec_;
};

TaskSpec good() { return {.action = {.name = "action"}, .observation = {{.name = "nothing"}}, .reward_terms = {"none"}}; }

Batch make(const TaskSpec& spec) {
  const auto world = testing::make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {2, 2, 2})}, {.start = Vec3(0, 0, 0)});
  BatchConfig config;
  config.num_threads = 1;
  return Batch(config, {world}, std::make_unique<Still>(spec));
}

TEST(TaskSpec, InvalidOnesAreRefused) {
  EXPECT_NO_THROW(make(good()));
  const std::vector<std::pair<std::string, std::function<void(TaskSpec&)>>> changes{
      {"int32, int64 or float32", [](TaskSpec& spec) { spec.action.type = DType::uint8; }},
      {"int32, int64 or float32", [](TaskSpec& spec) { spec.action.type = DType::boolean; }},
      {"int32, int64 or float32", [](TaskSpec& spec) { spec.action.type = DType::float64; }},
      {"a scalar", [](TaskSpec& spec) { spec.action = {.name = "action", .type = DType::int64, .shape = {2}}; }},
      {"one number as low", [](TaskSpec& spec) { spec.action.low = {0, 0}; }},
      {"one number as high", [](TaskSpec& spec) { spec.observation[0].high = {}; }},
      {"one number as absent", [](TaskSpec& spec) { spec.observation[0].absent = {0, 0, 0}; }},
      {"without negative extents", [](TaskSpec& spec) { spec.observation[0].shape = {-1}; }},
      {"low <= high", [](TaskSpec& spec) { spec.observation[0].low = {2}; }},
      {"low <= high", [](TaskSpec& spec) { spec.action.high = {std::nan("")}; }},
      {"within 32 bits",
       [](TaskSpec& spec) { spec.action = {.name = "action", .type = DType::int64, .low = {0}, .high = {1e300}}; }},
      {"at least one field", [](TaskSpec& spec) { spec.observation.clear(); }},
      {"different names", [](TaskSpec& spec) { spec.observation.push_back(spec.observation[0]); }},
  };
  for (const auto& [expected, change] : changes) {
    TaskSpec spec = good();
    change(spec);
    try {
      make(spec);
      ADD_FAILURE() << "accepted: " << expected;
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find(expected), std::string::npos) << error.what();
    }
  }
}

TEST(TaskSpec, ATasksArraysMayHaveTheNamesOfTheBatchs) {
  Batch batch = make(good());
  batch.reset({});
  const std::string blob = batch.snapshot();
  EXPECT_NO_THROW(batch.restore(blob));
}

TEST(TaskSpec, ATaskWithAnotherSpecRefusesItsSnapshot) {
  Batch one = make(good());
  one.reset({});
  TaskSpec spec = good();
  spec.observation[0].high = {2};
  Batch other = make(spec);
  EXPECT_THROW(other.restore(one.snapshot()), std::invalid_argument);
}

}  // namespace
}  // namespace flockstep
