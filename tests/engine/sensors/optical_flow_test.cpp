#include "flockstep/sensors/optical_flow.hpp"

#include "batch_helpers.hpp"
#include "statistics.hpp"

namespace flockstep {
namespace {

using namespace testing;

Batch with_flow(int num_drones, const OpticalFlowConfig& sensor) {
  BatchConfig config{.num_envs = num_drones, .num_threads = 1};
  config.dynamics = {.motion = Motion::rotors, .control = Control::velocity};
  config.optical_flows = {sensor};
  return Batch(config, {make_world({primitive(PrimitiveKind::room, {0, 0, 50}, {50, 50, 50})})});
}

const OpticalFlowReadings& flow_of(const Batch& batch) { return batch.readings<OpticalFlowReadings>(); }

// The angles at which a sensor sees a point of the world, in planes through its -z axis, when a drone has moved for a time.
Eigen::Vector2d seen(const Eigen::Vector3d& point, const Pose& pose, const Vec3& velocity, const Vec3& rates, const Vec3& offset,
                     double time_s) {
  const Eigen::Vector3d turn = rates.cast<double>() * time_s;
  Eigen::Quaterniond rotation = pose.rotation.cast<double>();
  if (turn.norm() > 0.0) rotation = rotation * Eigen::Quaterniond(Eigen::AngleAxisd(turn.norm(), turn.normalized()));
  const Eigen::Vector3d origin =
      pose.position.cast<double>() + velocity.cast<double>() * time_s + rotation * offset.cast<double>();
  const Eigen::Vector3d at = rotation.conjugate() * (point - origin);
  return {std::atan2(at.x(), -at.z()), std::atan2(at.y(), -at.z())};
}

TEST(OpticalFlow, IsTheMotionOfThePointBelow) {
  Random random(5);
  for (int i = 0; i < 20; ++i) {
    const Vec3 offset(random.within(-0.2F, 0.2F), random.within(-0.2F, 0.2F), random.within(-0.1F, 0.1F));
    Batch batch = with_flow(1, {.offset_m = {offset.x(), offset.y(), offset.z()}});
    const Quat tilt = Quat(Eigen::AngleAxisf(random.within(-3.0F, 3.0F), Vec3::UnitZ())) *
                      Quat(Eigen::AngleAxisf(random.within(-0.6F, 0.6F), Vec3::UnitX()));
    const Pose pose{Vec3(random.within(-5, 5), random.within(-5, 5), random.within(1, 8)), tilt};
    const Vec3 velocity(random.within(-3, 3), random.within(-3, 3), random.within(-2, 2));
    const Vec3 rates(random.within(-2, 2), random.within(-2, 2), random.within(-2, 2));
    batch.set_pose(std::vector<float>{pose.position.x(), pose.position.y(), pose.position.z()},
                   std::vector<float>{tilt.w(), tilt.x(), tilt.y(), tilt.z()});
    batch.set_velocity(std::vector<float>{velocity.x(), velocity.y(), velocity.z()},
                       std::vector<float>{rates.x(), rates.y(), rates.z()}, {});
    batch.sense();
    const Vec3 origin = pose.position + pose.rotation * offset, down = pose.rotation * -Vec3::UnitZ();
    const float distance = -origin.z() / down.z();  // the floor is z = 0
    EXPECT_NEAR(flow_of(batch).distance[0], distance, 1e-4F * distance);
    const Eigen::Vector3d point = (origin + distance * down).cast<double>();
    constexpr double kTimeS = 1e-4;
    const Eigen::Vector2d flow =
        (seen(point, pose, velocity, rates, offset, kTimeS) - seen(point, pose, velocity, rates, offset, -kTimeS)) /
        (2.0 * kTimeS);
    for (std::size_t axis = 0; axis < 2; ++axis) {
      EXPECT_NEAR(static_cast<double>(flow_of(batch).flow[axis]), flow[static_cast<Eigen::Index>(axis)], 1e-3) << i;
    }
  }
}

TEST(OpticalFlow, IsZeroIfNothingIsSeen) {
  Batch batch = with_flow(2, {.max_range_m = 3.0F, .noise_std_radps = 0.5F});
  batch.set_pose(std::vector<float>{0, 0, 2, 0, 0, 4}, {});
  batch.set_velocity(std::vector<float>{1, 1, 1, 1, 1, 1}, {}, {});
  batch.sense();
  EXPECT_FLOAT_EQ(flow_of(batch).distance[0], 2.0F);
  EXPECT_NE(flow_of(batch).flow[0], 0.0F);
  EXPECT_TRUE(std::isinf(flow_of(batch).distance[1]));
  EXPECT_EQ(flow_of(batch).flow[2], 0.0F);
  EXPECT_EQ(flow_of(batch).flow[3], 0.0F);
}

TEST(OpticalFlow, HasNoiseAndALimit) {
  constexpr std::size_t kDrones = 2000;
  Batch batch = with_flow(kDrones, {.max_flow_radps = 1.25F, .noise_std_radps = 0.25F});
  std::vector<float> position, velocity;
  for (std::size_t i = 0; i < kDrones; ++i) {
    position.insert(position.end(), {0.0F, 0.0F, 2.0F});
    velocity.insert(velocity.end(), {0.0F, 10.0F, 0.0F});  // -5 rad/s along y
  }
  batch.set_pose(position, {});
  batch.set_velocity(velocity, {}, {});
  std::vector<double> noise;
  for (int reading = 0; reading < 500; ++reading) {
    batch.sense();
    for (std::size_t i = 0; i < kDrones; ++i) {
      noise.push_back(static_cast<double>(flow_of(batch).flow[2 * i]));
      EXPECT_EQ(flow_of(batch).flow[2 * i + 1], -1.25F);
    }
  }
  EXPECT_TRUE(has_mean(noise, 0.0));
  EXPECT_TRUE(has_mean(products(noise, noise), 0.0625));
}

TEST(OpticalFlow, RefusesKinematicMotion) {
  BatchConfig config{.optical_flows = {OpticalFlowConfig{}}};
  EXPECT_REFUSED(config.validate(), "optical_flow: ... kinematic");
  EXPECT_NO_THROW(OpticalFlowConfig::preset("pmw3901").validate());
  EXPECT_REFUSED(OpticalFlowConfig::preset("pwm3901"), "OpticalFlowConfig.preset: ... pmw3901");
}

}  // namespace
}  // namespace flockstep
