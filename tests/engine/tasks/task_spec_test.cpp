// Checks that a batch makes on the specification and names of any task.
#include "batch_helpers.hpp"
#include "flockstep/neighbors.hpp"

namespace flockstep {
namespace {

using namespace testing;

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
  const auto world = make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {2, 2, 2})}, {.start = Vec3(0, 0, 0)});
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
    EXPECT_REFUSED(make(spec), expected);
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

// -- The neighbours of drones, against a sort of all distances.

struct Drones {
  State state;
  PoseReadings sensed;
  std::vector<float> velocity;

  explicit Drones(std::size_t count) {
    state.active.assign(count, 1);
    sensed.position.assign(3 * count, 0.0F);
    sensed.quat_wxyz.assign(4 * count, 0.0F);
    for (std::size_t drone = 0; drone < count; ++drone) sensed.quat_wxyz[4 * drone] = 1.0F;
    velocity.assign(3 * count, 0.0F);
  }
  Eigen::Vector3d position(std::size_t drone) const { return Vec3::Map(sensed.position.data() + 3 * drone).cast<double>(); }
  Eigen::Quaterniond rotation(std::size_t drone) const {
    const float* const q = sensed.quat_wxyz.data() + 4 * drone;
    return Quat(q[0], q[1], q[2], q[3]).cast<double>();
  }
  std::vector<float> neighbors(std::size_t per_env, std::size_t drone, std::size_t count) const {
    std::vector<float> out(kNeighborSize * count, -1.0F);
    write_neighbors(state, sensed, per_env, DroneIndex(drone), velocity, out);
    return out;
  }
};

Drones random_drones(Random& random, std::size_t count) {
  Drones drones(count);
  for (std::size_t drone = 0; drone < count; ++drone) {
    drones.state.active[drone] = random.within(0.0F, 1.0F) < 0.8F;
    const Quat turned =
        Quat(random.within(-1.0F, 1.0F), random.within(-1.0F, 1.0F), random.within(-1.0F, 1.0F), 0.5F).normalized();
    const float quat[]{turned.w(), turned.x(), turned.y(), turned.z()};
    std::copy_n(quat, 4, drones.sensed.quat_wxyz.data() + 4 * drone);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      drones.sensed.position[3 * drone + axis] = random.within(-5.0F, 5.0F);
      drones.velocity[3 * drone + axis] = random.within(-2.0F, 2.0F);
    }
  }
  return drones;
}

TEST(Neighbors, AreTheNearestOfTheEnv) {
  Random random(1);
  for (int round = 0; round < 200; ++round) {
    const std::size_t per_env = 1 + static_cast<std::size_t>(round) % 9, count = 1 + static_cast<std::size_t>(round) % 5;
    const Drones drones = random_drones(random, 3 * per_env);
    for (std::size_t drone = 0; drone < 3 * per_env; ++drone) {
      std::vector<std::size_t> others;
      for (std::size_t other = 0; other < 3 * per_env; ++other) {
        const bool is_there = drones.state.active[other] && drones.state.active[drone];
        if (is_there && other != drone && other / per_env == drone / per_env) others.push_back(other);
      }
      std::ranges::sort(others, {}, [&](std::size_t other) { return (drones.position(other) - drones.position(drone)).norm(); });
      const std::vector<float> block = drones.neighbors(per_env, drone, count);
      for (std::size_t i = 0; i < count; ++i) {
        const float* const numbers = block.data() + kNeighborSize * i;
        if (i >= others.size()) {
          EXPECT_TRUE(std::all_of(numbers, numbers + kNeighborSize, [](float number) { return number == 0.0F; }));
          continue;
        }
        const Eigen::Matrix3d to_body = drones.rotation(drone).toRotationMatrix().transpose();
        const Eigen::Vector3d apart = to_body * (drones.position(others[i]) - drones.position(drone));
        const Vec3 moving = Vec3::Map(drones.velocity.data() + 3 * others[i]) - Vec3::Map(drones.velocity.data() + 3 * drone);
        EXPECT_LT((Vec3::Map(numbers).cast<double>() - apart).norm(), 1e-5);
        EXPECT_LT((Vec3::Map(numbers + 3).cast<double>() - to_body * moving.cast<double>()).norm(), 1e-5);
        EXPECT_EQ(numbers[6], 1.0F);
      }
    }
  }
}

TEST(Neighbors, EquallyDistantOnesAreOrderedByNumber) {
  Drones drones(4);
  for (const std::size_t other : {0U, 1U, 3U}) drones.sensed.position[3 * other] = other == 1 ? -2.0F : 2.0F;
  drones.velocity[0] = 5.0F;
  const std::vector<float> block = drones.neighbors(4, 2, 4);
  EXPECT_EQ(block[3], 5.0F) << "drone 0";
  EXPECT_EQ(block[7], -2.0F) << "drone 1";
  EXPECT_EQ(block[14], 2.0F) << "drone 3";
  EXPECT_EQ(block[17], 0.0F);
  EXPECT_EQ(block[27], 0.0F) << "there is no fourth";
}

TEST(Neighbors, VelocitiesMayBeAbsent) {
  Drones drones(2);
  drones.sensed.position[0] = 1.0F;
  drones.velocity.clear();
  EXPECT_EQ(drones.neighbors(2, 1, 1), (std::vector<float>{1, 0, 0, 0, 0, 0, 1}));
}

}  // namespace
}  // namespace flockstep
