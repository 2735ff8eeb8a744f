#include "flockstep/sensors/magnetometer.hpp"

#include "resting_drones.hpp"
#include "statistics.hpp"

namespace flockstep {
namespace {

using namespace testing;

Batch with_magnetometer(int num_drones, const MagnetometerConfig& magnetometer) {
  BatchConfig config = resting(num_drones);
  config.magnetometers = {magnetometer};
  return make_resting(config);
}

const std::vector<float>& field_of(const Batch& batch) { return batch.readings<MagnetometerReadings>().field; }

// A quarter turn to the left, then a mounting that looks down.
TEST(Magnetometer, ReadsTheFieldInItsOwnFrame) {
  const float half = std::sqrt(0.5F);
  Batch batch = with_magnetometer(1, {.field_ut = {1.0F, 20.0F, -45.0F}, .quat_wxyz = {half, 0, half, 0}});
  batch.set_pose({}, std::vector<float>{half, 0, 0, half});
  batch.sense();
  // In the body frame, x' is the world's y and y' the world's -x. The sensor's x is the body's -z, its z the body's x.
  const Vec3 expected(45.0F, -1.0F, 20.0F);
  EXPECT_LT((Vec3::Map(field_of(batch).data()) - expected).norm(), 1e-4F) << Vec3::Map(field_of(batch).data()).transpose();
}

TEST(Magnetometer, HasTheErrorsOfItsConfiguration) {
  constexpr int kDrones = 2000;
  const Vec3 field(3.0F, 20.0F, -40.0F);
  Batch batch = with_magnetometer(
      kDrones, {.field_ut = {3.0F, 20.0F, -40.0F}, .noise_std_ut = 0.5F, .hard_iron_std_ut = 2.0F, .soft_iron_std = 0.05F});
  std::vector<std::vector<double>> readings;
  for (int i = 0; i < 200; ++i) {  // 1.2 million numbers
    i == 0 ? batch.sense() : read_next(batch);
    std::vector<double>& errors = readings.emplace_back();
    for (std::size_t k = 0; k < 3 * kDrones; ++k) {
      errors.push_back(static_cast<double>(field_of(batch)[k] - field[static_cast<Eigen::Index>(k % 3)]));
    }
  }
  const double constant = 4.0 + 0.0025 * static_cast<double>(field.squaredNorm());
  EXPECT_TRUE(has_mean(readings[0], 0.0));
  EXPECT_TRUE(has_mean(products(readings[0], readings[0]), constant + 0.25));
  EXPECT_TRUE(has_mean(products(readings[0], readings[199]), constant)) << "iron stays, noise does not";
  std::vector<double> white;
  for (std::size_t k = 0; k < 3 * kDrones; ++k) {
    std::vector<double> series;
    for (const auto& errors : readings) series.push_back(errors[k]);
    white.push_back(moments(series).variance);
  }
  EXPECT_TRUE(has_mean(white, 0.25));
}

// Only the soft iron depends on the attitude: upside down, a horizontal axis has errors of the same hard iron.
TEST(Magnetometer, IronIsFixedInTheSensor) {
  Batch batch = with_magnetometer(500, {.field_ut = {0.0F, 0.0F, -40.0F}, .hard_iron_std_ut = 2.0F, .soft_iron_std = 0.1F});
  batch.sense();
  const std::vector<float> level = field_of(batch);
  std::vector<float> over;
  for (int i = 0; i < 500; ++i) over.insert(over.end(), {0.0F, 1.0F, 0.0F, 0.0F});
  batch.set_pose({}, over);
  batch.sense();
  std::vector<double> hard, soft;
  for (std::size_t i = 0; i < level.size(); i += 3) {
    hard.push_back(0.5 * static_cast<double>(field_of(batch)[i] + level[i]));
    soft.push_back(0.5 * static_cast<double>(field_of(batch)[i] - level[i]));
  }
  EXPECT_TRUE(has_mean(products(hard, hard), 4.0));
  EXPECT_TRUE(has_mean(products(soft, soft), 16.0));
  EXPECT_TRUE(has_mean(products(hard, soft), 0.0));
}

TEST(Magnetometer, HasPresets) {
  EXPECT_EQ(MagnetometerConfig::preset("airsim").noise_std_ut, 0.5F);
  EXPECT_REFUSED(MagnetometerConfig::preset(""), "MagnetometerConfig.preset: ... airsim, px4-sih");
}

}  // namespace
}  // namespace flockstep
