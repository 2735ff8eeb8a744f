// Measures the cost of simulated rotor flight on one thread, and compares the engine's kernel with the minimal code that solves
// the same equations (bare_flight-inl.hpp). Variants run in turns. A drone-substep is one tick of one drone. Prints a JSON list
// of figures.
//
// With "rates" only the body-rate controller runs. bench/run.py alternates it with timed steps of an environment, so it warms
// up first, because an idle processor is slow at first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "dynamics.cpp"
#include <hwy/foreach_target.h>
// Highway's headers must come after foreach_target.
#include <hwy/highway.h>

#include "bare_flight-inl.hpp"

#if HWY_ONCE
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "base/platform.hpp"
#include "bench.hpp"
#include "dynamics/flight.hpp"
#include "flockstep/batch.hpp"

namespace bench {
HWY_EXPORT(fly_bare);

void fly_bare(const Quadrotor& quadrotor, const Flight& flight, flockstep::dynamics::Flock& flock) {
  HWY_DYNAMIC_DISPATCH(fly_bare)(quadrotor, flight, flock);
}
}  // namespace bench

namespace {

using flockstep::Airframe, flockstep::Control, flockstep::DroneModel, flockstep::DynamicsConfig, flockstep::Integrator,
    flockstep::Motion, flockstep::Vec3;
using flockstep::dynamics::Flock, flockstep::dynamics::kLanes, flockstep::dynamics::Physics;

constexpr int kRuns = 51;
constexpr double kSlice = 1e-3;  // s, time per run: short, so that most runs on a busy machine are not interrupted
constexpr double kDt = 0.002;    // s
constexpr int kTicks = 5;        // per policy step, at 100 Hz
constexpr int kSteps = 20;       // policy steps per flight
constexpr double kSubsteps = static_cast<double>(kLanes) * kTicks * kSteps;

Airframe kingfisher() { return *DroneModel::load("kingfisher").airframe(); }

// The kingfisher with the hummingbird's values for the coefficients it lacks.
Airframe with_every_term() {
  Airframe frame = kingfisher();
  const Airframe other = *DroneModel::load("hummingbird").airframe();
  frame.rotor_drag = other.rotor_drag;
  frame.rotor_inertia_kgm2 = other.rotor_inertia_kgm2;
  return frame;
}

DynamicsConfig by_rotors(Control control, Integrator integrator = Integrator::midpoint) {
  DynamicsConfig config;
  config.motion = Motion::rotors;
  config.control = control;
  config.integrator = integrator;
  return config;
}

// Only gravity, thrust and rotor lag.
DynamicsConfig without_terms(Integrator integrator = Integrator::midpoint) {
  DynamicsConfig config = by_rotors(Control::rotor_speeds, integrator);
  config.rotor_drag = config.body_drag = config.gyroscopic = false;
  return config;
}

// Starts near hover with small random differences. The commands are close to hover: rotor speeds or controller setpoints.
Flock begin(const Airframe& frame, Control control, const Vec3& wind) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> little(-0.005F, 0.005F);
  const auto hover = static_cast<float>(frame.hover_speed());
  Flock flock;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    flock.rotation[0][lane] = 1.0F;
    flock.height[lane] = 0.5F;
    for (std::size_t i = 0; i < 3; ++i) {
      flock.velocity[i][lane] = 100.0F * little(random);
      flock.wind[i][lane] = wind[static_cast<Eigen::Index>(i)];
    }
    for (std::size_t i = 0; i < flockstep::kMinRotors; ++i) {
      flock.rotor[i][lane] = flock.rotor_command[i][lane] = hover * (1.0F + little(random));
      if (control == Control::rotor_speeds) flock.setpoint[i][lane] = hover * (1.0F + little(random));
    }
    const float small = 20.0F * little(random);
    const bool has_thrust = control == Control::body_rates || control == Control::attitude;
    if (has_thrust) flock.setpoint[0][lane] = static_cast<float>(flockstep::kGravity);
    if (control == Control::body_rates) flock.setpoint[1][lane] = small;
    if (control == Control::attitude) {
      flock.setpoint[1][lane] = small;
      flock.setpoint[3][lane] = std::sqrt(1.0F - small * small);
      flock.setpoint[4][lane] = 1.0F;
    }
    if (control == Control::velocity || control == Control::position) flock.setpoint[0][lane] = 10.0F * small;
    if (control == Control::position || control == Control::acceleration) flock.setpoint[3][lane] = 1.0F;
  }
  return flock;
}

// Repeats 0.2 s of flight with the engine's kernel.
class Flying {
 public:
  Flying(const Airframe& frame, const DynamicsConfig& config, const Vec3& wind = Vec3::Zero())
      : physics_(frame, config, kDt, 1), begin_(begin(frame, config.control, wind)) {}

  void operator()() {
    flock = begin_;
    for (int step = 0; step < kSteps; ++step) flockstep::dynamics::fly(physics_, flock, 0, kTicks);
  }

  Flock flock;

 private:
  Physics physics_;
  Flock begin_;
};

bench::Variant variant(const std::string& label, const Airframe& frame, const DynamicsConfig& config,
                       const Vec3& wind = Vec3::Zero()) {
  return {label, [flying = std::make_shared<Flying>(frame, config, wind)] { (*flying)(); }};
}

std::vector<double> million_per_second(const std::vector<double>& times) { return bench::rates(times, kSubsteps / 1e6); }

// ----------------------------------------------------------------------------------------- compared with the bare kernel

bench::Quadrotor numbers_of(const Airframe& frame) {
  bench::Quadrotor q{};
  q.mass = static_cast<float>(frame.mass_kg);
  for (std::size_t i = 0; i < 3; ++i) {
    q.inertia[i] = static_cast<float>(frame.inertia_kgm2[i]);
    q.thrust[i] = static_cast<float>(frame.thrust_n[i]);
    q.linear_drag[i] = static_cast<float>(frame.linear_drag[i]);
    q.quadratic_drag[i] = static_cast<float>(frame.quadratic_drag[i]);
  }
  for (std::size_t i = 0; i < 4; ++i) {
    q.x[i] = static_cast<float>(frame.position_m[i][0]);
    q.y[i] = static_cast<float>(frame.position_m[i][1]);
    q.yaw[i] = static_cast<float>(frame.spin[i] == flockstep::Spin::ccw ? -frame.torque_ratio_m : frame.torque_ratio_m);
  }
  q.lag_up = static_cast<float>(frame.lag_up_s);
  q.lag_down = static_cast<float>(frame.lag_down_s);
  return q;
}

// Exits unless both kernels end at the same positions, because otherwise their times are not comparable.
void require_same_flight(const Flock& a, const Flock& b) {
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const float away = std::abs(a.travelled[i][lane] - b.travelled[i][lane]);
      if (away < 1e-3F && std::abs(a.turn[i][lane] - b.turn[i][lane]) < 1e-3F) continue;
      std::fprintf(stderr, "the bare kernel ends at another position: by %g m\n", static_cast<double>(away));
      std::exit(1);
    }
  }
}

void beside_bare(const std::string& name, Integrator integrator, bench::Figures& figures) {
  const Airframe frame = kingfisher();
  const bench::Quadrotor numbers = numbers_of(frame);
  DynamicsConfig config = without_terms(integrator);
  config.body_drag = true;
  Flying engine(frame, config);
  const Flock start = begin(frame, Control::rotor_speeds, Vec3::Zero());
  Flock flock;
  const auto bare = [&](bool fused) {
    flock = start;
    const bench::Flight flight{static_cast<float>(kDt), kTicks, integrator == Integrator::rk4, fused};
    for (int step = 0; step < kSteps; ++step) bench::fly_bare(numbers, flight, flock);
  };
  engine();
  for (const bool fused : {false, true}) {
    bare(fused);
    require_same_flight(engine.flock, flock);
  }
  const bench::Times times = bench::interleave(
      {{"engine", [&] { engine(); }}, {"bare", [&] { bare(false); }}, {"bare fused", [&] { bare(true); }}}, kRuns, kSlice);
  const std::string at = "dynamics/" + name;
  figures.add(at + "/ratio_to_bare", bench::ratios(times[1], times[0]), "1");
  figures.add(at + "/ratio_to_bare_fused", bench::ratios(times[2], times[0]), "1");
  figures.add(at + "/million_substeps_per_second", million_per_second(times[0]), "1/s");
}

// ------------------------------------------------------------------------------------------------- controllers and terms

void controllers(bench::Figures& figures) {
  const std::pair<const char*, Control> stages[] = {{"rates", Control::body_rates},
                                                    {"attitude", Control::attitude},
                                                    {"acceleration", Control::acceleration},
                                                    {"velocity", Control::velocity},
                                                    {"position", Control::position}};
  const Vec3 wind(3.0F, 1.0F, 0.0F);
  std::vector<bench::Variant> variants;
  for (const auto& [name, control] : stages) variants.push_back(variant(name, kingfisher(), by_rotors(control), wind));
  DynamicsConfig all = by_rotors(Control::position);
  all.ground_effect = true;
  variants.push_back(variant("everything", with_every_term(), all, wind));
  const bench::Times times = bench::interleave(variants, kRuns, kSlice);
  for (std::size_t v = 0; v < variants.size(); ++v) {
    figures.add("dynamics/" + variants[v].label + "/million_substeps_per_second", million_per_second(times[v]), "1/s");
  }
}

// Measures the time that each term adds to a flight without terms.
void terms(bench::Figures& figures) {
  std::vector<bench::Variant> variants{variant("gravity,_thrust_and_lag_alone", kingfisher(), without_terms())};
  const auto add = [&](const std::string& name, const Airframe& frame, const std::function<void(DynamicsConfig&)>& change) {
    DynamicsConfig config = without_terms();
    change(config);
    variants.push_back(variant(name, frame, config));
  };
  Airframe without_lift = with_every_term();
  without_lift.rotor_lift = 0.0;
  add("body_drag", kingfisher(), [](DynamicsConfig& config) { config.body_drag = true; });
  add("rotor_drag", without_lift, [](DynamicsConfig& config) { config.rotor_drag = true; });
  // Lift is the only effect of this switch for a kingfisher.
  add("rotor_lift", kingfisher(), [](DynamicsConfig& config) { config.rotor_drag = true; });
  add("gyroscopic", with_every_term(), [](DynamicsConfig& config) { config.gyroscopic = true; });
  add("controller_of_rates", kingfisher(), [](DynamicsConfig& config) { config.control = Control::body_rates; });
  add("controller_of_positions", kingfisher(), [](DynamicsConfig& config) { config.control = Control::position; });
  const bench::Times times = bench::interleave(variants, kRuns, kSlice);
  for (std::size_t v = 0; v < variants.size(); ++v) {
    std::vector<double> ns;
    for (std::size_t run = 0; run < times[v].size(); ++run) {
      ns.push_back(1e9 * (times[v][run] - (v > 0 ? times[0][run] : 0.0)) / kSubsteps);
    }
    figures.add("dynamics/cost/" + variants[v].label + "/ns_per_substep", ns, "ns");
  }
}

}  // namespace

int main(int argc, char** argv) {
  const flockstep::FlushDenormals flush;
  bench::Figures figures;
  if (argc > 1 && std::string(argv[1]) == "rates") {
    constexpr double kTurn = 0.01;  // s, time per run
    const bench::Variant rates = variant("rates", kingfisher(), by_rotors(Control::body_rates));
    bench::interleave({rates}, kRuns / 2, kTurn);  // warm-up
    const bench::Times times = bench::interleave({rates}, kRuns, kTurn);
    figures.add("dynamics/rates_alone/million_substeps_per_second", million_per_second(times[0]), "1/s");
    figures.print();
    return 0;
  }
  beside_bare("midpoint", Integrator::midpoint, figures);
  beside_bare("rk4", Integrator::rk4, figures);
  controllers(figures);
  terms(figures);
  figures.print();
}
#endif  // HWY_ONCE
