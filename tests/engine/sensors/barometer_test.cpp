#include "flockstep/sensors/barometer.hpp"

#include "resting_drones.hpp"
#include "statistics.hpp"

namespace flockstep {
namespace {

using namespace testing;

Batch with_barometer(int num_drones, const BarometerConfig& barometer) {
  BatchConfig config = resting(num_drones);
  config.barometers = {barometer};
  return make_resting(config);
}

const BarometerReadings& barometer_of(const Batch& batch) { return batch.readings<BarometerReadings>(); }

// Values of the ICAO Standard Atmosphere (Doc 7488), geopotential altitude.
TEST(Barometer, ReadsTheStandardAtmosphere) {
  for (const auto& [altitude_m, pressure_pa] :
       {std::pair{-500.0F, 107477.0F}, {0.0F, 101325.0F}, {500.0F, 95460.8F}, {1000.0F, 89874.6F}, {3000.0F, 70108.5F}}) {
    for (const float ground_m : {0.0F, 400.0F}) {
      Batch batch = with_barometer(1, {.altitude_m = ground_m});
      batch.set_pose(std::vector<float>{1.0F, 2.0F, altitude_m - ground_m}, {});
      batch.sense();
      EXPECT_NEAR(barometer_of(batch).pressure[0], pressure_pa, 2e-5F * pressure_pa) << altitude_m;
      EXPECT_NEAR(barometer_of(batch).height[0], altitude_m - ground_m, 0.01F) << altitude_m;
    }
  }
}

TEST(Barometer, HasTheErrorsOfItsConfiguration) {
  constexpr int kDrones = 1000, kReadings = 1000;
  Batch batch =
      with_barometer(kDrones, {.noise_std_pa = 3.0F, .bias_std_pa = 20.0F, .drift_std_pa = 10.0F, .drift_time_s = 5.0F});
  batch.sense();
  const double truth = 101325.0;
  std::vector<std::vector<double>> readings;
  for (int i = 0; i < kReadings; ++i) {
    if (i > 0) read_next(batch);
    std::vector<double>& errors = readings.emplace_back();
    for (const float pressure : barometer_of(batch).pressure) errors.push_back(static_cast<double>(pressure) - truth);
  }
  const std::vector<double>& first = readings.front();
  const std::vector<double>& last = readings.back();
  EXPECT_TRUE(has_mean(first, 0.0));
  EXPECT_TRUE(has_mean(products(first, first), 9.0 + 400.0)) << "the drift begins at 0";
  EXPECT_TRUE(has_mean(products(last, last), 9.0 + 400.0 + 100.0));
  EXPECT_TRUE(has_mean(products(first, last), 400.0)) << "the bias is constant";
  const auto covariance = [](double lag) { return 100.0 * std::exp(-lag * kReadingS / 5.0) + (lag == 0.0 ? 9.0 : 0.0); };
  for (const std::size_t lag : {1U, 100U, 300U}) {
    const std::vector<double>& before = readings[readings.size() - 1 - lag];
    EXPECT_TRUE(has_mean(products(last, before), 400.0 + covariance(static_cast<double>(lag)))) << lag;
  }
  expect_allan_of(std::span(readings).subspan(300), covariance);
}

TEST(Barometer, DrawsABiasForEachEpisode) {
  Batch batch = with_barometer(400, {.bias_std_pa = 20.0F});
  batch.sense();
  const std::vector<float> first = barometer_of(batch).pressure;
  read_next(batch);
  EXPECT_EQ(barometer_of(batch).pressure, first);
  batch.begin_episode();
  batch.sense();
  std::vector<double> difference;
  for (std::size_t i = 0; i < first.size(); ++i) {
    difference.push_back(static_cast<double>(barometer_of(batch).pressure[i]) - static_cast<double>(first[i]));
  }
  EXPECT_TRUE(has_mean(products(difference, difference), 800.0));
}

TEST(Barometer, StaysFiniteAtTheEndsOfTheWorld) {
  Batch batch = with_barometer(2, {.noise_std_pa = 10000.0F});
  batch.set_pose(std::vector<float>{0, 0, 1e6F, 0, 0, -1e6F}, {});
  for (int i = 0; i < 100; ++i) {
    batch.sense();
    for (const float pressure : barometer_of(batch).pressure) EXPECT_GE(pressure, 0.0F);
    for (const float height : barometer_of(batch).height) EXPECT_TRUE(std::isfinite(height));
  }
}

TEST(Barometer, HasPresets) {
  EXPECT_EQ(BarometerConfig::preset("px4-sih").noise_std_pa, 1.0F);
  EXPECT_NO_THROW(BarometerConfig::preset("airsim").validate());
  EXPECT_REFUSED(BarometerConfig::preset("airsimm"), "BarometerConfig.preset: ... px4-sih, airsim ... airsimm");
}

}  // namespace
}  // namespace flockstep
