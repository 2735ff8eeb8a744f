// LearnerParts: what a Learner consists of. Its methods are in learner.cpp (state, acting), collection.cpp (a rollout step by
// step), or within the steps of a batch) and update.cpp.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "base/platform.hpp"
#include "base/workers.hpp"
#include "flockstep/aligned.hpp"
#include "flockstep/learner.hpp"
#include "learning/distribution.hpp"
#include "learning/network.hpp"
#include "learning/rollout.hpp"
#include "tasks/flight_gradient.hpp"

namespace flockstep::learning {

// SingleCaller: admits one thread at a time to an object, and only the process that made it.
class SingleCaller {
 public:
  // Admits the calling thread during its lifetime; nested calls of the same thread are allowed. Throws std::runtime_error if
  // another thread is in a call, and in a child of the process that made the object.
  class Call {
   public:
    explicit Call(SingleCaller& callers) : callers_(callers) {
      if (process_id() != callers.owner_) {
        throw std::runtime_error("this Learner was made in process " + std::to_string(callers.owner_) +
                                 " and used in its child " + std::to_string(process_id()) +
                                 ": a learner does not survive fork(), make or load one in the child");
      }
      std::thread::id nobody;
      const std::thread::id self = std::this_thread::get_id();
      is_outermost_ = callers.thread_.compare_exchange_strong(nobody, self, std::memory_order_acquire);
      if (!is_outermost_ && nobody != self) {
        throw std::runtime_error("this Learner is in use by another thread: one call at a time");
      }
    }
    ~Call() {
      if (is_outermost_) callers_.thread_.store({}, std::memory_order_release);
    }
    Call(const Call&) = delete;
    Call& operator=(const Call&) = delete;

   private:
    SingleCaller& callers_;
    bool is_outermost_ = false;
  };

 private:
  std::atomic<std::thread::id> thread_{};  // in a call
  const long owner_ = process_id();
};

}  // namespace flockstep::learning

namespace flockstep {
namespace learning {

constexpr float kClip = 10.0F;         // largest magnitude that normalised observations and rewards keep
constexpr double kMinVariance = 1e-8;  // added to their variances

// Means over the steps of a minibatch, as sums of its chunks.
struct Sums {
  double policy = 0.0, value = 0.0, entropy = 0.0, clipped = 0.0, kl = 0.0;

  Sums& operator+=(const Sums& other) {
    policy += other.policy;
    value += other.value;
    entropy += other.entropy;
    clipped += other.clipped;
    kl += other.kl;
    return *this;
  }
};

// kLanes consecutive drones.
struct GradientGroup {
  dynamics::LaneDrones drones{};
  std::vector<task::GradientStep> steps;       // of the window
  std::vector<task::GroupNumbers> numbers;     // of the drones' episodes
  std::vector<std::size_t> number_of;          // for each step, its row of `numbers`
  alignas(64) dynamics::FlownLanes d_flown{};  // derivatives by the state after the step that is being pulled back
  alignas(64) dynamics::Lanes<4> d_action{};   // by its action, from the steps after it
  AlignedVector<dynamics::Lanes<4>> d_sent;    // by the commands that the steps sent, if they may be late
};

// The steps through which a Learner differentiates.
struct GradientWindow {
  std::vector<GradientGroup> groups;
  std::vector<TapeMemory<float>> memory;  // one per thread
  AlignedVector<float> inputs;            // (steps, rows, padded inputs of the networks)
  AlignedVector<float> observation;       // (steps, rows, observation)
  AlignedVector<float> chosen;            // (steps, rows, actions), before they are limited
};

// Returns the number of rows of `size` values each.
std::size_t rows_of(std::span<const float> values, std::size_t size, const char* name);
void require_size(std::size_t got, std::size_t expected, const char* name);
// Throws NotFiniteError that names the row, of `size` values each, with the first value that is NaN or infinite. The first row
// has the given number.
void require_finite(std::span<const float> values, std::size_t size, const char* name, std::size_t first_row = 0);

}  // namespace learning

// State is documented in learner.hpp.
struct Learner::Parts {
  using Pass = learning::Pass;

  Parts(NetworkConfig new_config, int num_threads, std::uint64_t new_seed);
  ~Parts();

  // Returns *this. Throws if another thread is in a call.
  const Parts& idle() const {
    const learning::SingleCaller::Call call(callers);
    return *this;
  }

  std::size_t size() const { return rollout.steps * rollout.rows; }
  std::size_t action_size() const { return distribution.action_size(); }

  // Call it after the parameters have changed.
  void prepare();
  // Writes the inputs of the networks for one observation, of all numbers or of the actor's. normalised: memory for it.
  void write_inputs(std::span<const float> observation, std::vector<float>& normalised, float* inputs) const;
  // Calls f(pass, first row, rows) for all rows, a few at a time, on all threads; the inputs of the pass are those of the rows.
  template <class F>
  void for_observations(std::span<const float> observations, std::size_t rows, const F& f) {
    const std::size_t width = observations.size() / std::max<std::size_t>(rows, 1);
    workers.run((rows + Pass::kRows - 1) / Pass::kRows, [&](std::size_t part, std::size_t thread) {
      Pass& pass = passes[thread];
      std::vector<float> normalised;
      const std::size_t from = part * Pass::kRows, count = std::min(Pass::kRows, rows - from);
      for (std::size_t i = 0; i < count; ++i) {
        write_inputs(observations.subspan((from + i) * width, width), normalised, pass.inputs() + i * input_stride);
      }
      f(pass, from, count);
    });
  }
  void write_values(std::span<const float> observations, std::span<float> values);
  // Takes the observations of the rows that fly into account if they are normalised. skipped: (R,), or empty: all fly.
  void take_observations(std::span<const float> observations, std::span<const std::uint8_t> skipped);

  // Draws the actions of rows of step t, whose inputs are those of the pass, and keeps what the update needs.
  void draw_actions(Pass& pass, std::size_t t, std::size_t from, std::size_t count);
  // Throws if fly() cannot step the batch, of this number of rows.
  void require_fits(const Batch& batch, std::size_t rows) const;
  void make_passes(const Batch& batch);  // one for each of its threads, too
  class StepPilot;

  // Draws the minibatches of an epoch: all steps that count, in random order.
  void draw_order();
  // Fills gradients[0] with the gradient of a minibatch.
  learning::Sums add_gradients(const UpdateConfig& update, std::span<const std::int64_t> minibatch);
  learning::Sums add_chunk(const UpdateConfig& update, std::span<const std::int64_t> chunk, std::size_t minibatch_size,
                           Pass& pass, AlignedVector<float>& gradient);

  const NetworkConfig config;
  const std::size_t observation_size, actor_size, input_stride;  // actor_size: numbers of an observation that the actor gets
  const learning::Network network;
  learning::Distribution distribution;
  const std::uint64_t seed;
  AlignedVector<float> parameters, adam_m, adam_v, transposed;
  std::int64_t adam_steps = 0;
  std::uint64_t draws = 0;
  RunningMoments observation_moments, return_moments;
  std::vector<double> discounted;  // (R,) return so far of each row, for normalised rewards

  learning::Rollout rollout;
  int next = 0;              // step that act() or record() takes next
  bool is_finished = false;  // finish() has estimated the advantages of the rollout
  std::vector<std::int64_t> order;
  std::vector<AlignedVector<float>> gradients;         // one per chunk of the minibatch
  double advantage_mean = 0.0, advantage_scale = 1.0;  // normalise the minibatch's advantages
  Workers workers;
  std::vector<Pass> passes;                          // one per thread
  std::unique_ptr<learning::GradientWindow> window;  // null until the first window
  mutable learning::SingleCaller callers;            // held during each call
};

}  // namespace flockstep
