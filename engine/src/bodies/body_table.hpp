// BodyTable: the bodies of a batch. It moves them, and offers views of them to the stages that trace, collide and render.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "bodies/body_model.hpp"
#include "collision/moving_bodies.hpp"
#include "flockstep/array_visitor.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"
#include "render/appearance.hpp"
#include "trace/bodies.hpp"

namespace flockstep::bodies {

// Envs are independent: threads may change different envs at the same time, except through add_model() and restored().
class BodyTable {
 public:
  // state, and what worlds_of returns, must outlive the table. The state's arrays of bodies are allocated and hold none.
  // models_of(env): bodies of the env's current world.
  BodyTable(State& state, const std::vector<BodyConfig>& configs, std::size_t per_env, double tick_s,
            std::function<Models(EnvIndex)> models_of);

  bool empty() const { return per_env_ == 0; }
  std::size_t per_env() const { return per_env_; }  // B
  std::size_t row_of(EnvIndex env, std::size_t body) const { return env * per_env_ + body; }

  // --- time; State::tick is that of the last advance() or begin()
  void begin(EnvIndex env);  // the bodies of world and configuration, in the first slots, at the start of an episode
  void advance(EnvIndex env, std::int64_t tick);  // to that tick of the episode, the one after the current tick

  // --- changes of single bodies
  // Adds a configuration for put(). Returns its number; equal configurations share one.
  std::int32_t add_model(const BodyConfig& config);
  // Puts a body of a model into a slot: scripted, at the env's current tick.
  void put(EnvIndex env, std::size_t body, std::int32_t model);
  void remove(EnvIndex env, std::size_t body);
  // The body leaves its script until the next episode.
  void set_pose(EnvIndex env, std::size_t body, const Pose& pose);
  void set_velocity(EnvIndex env, std::size_t body, const Velocity& velocity);
  const BodyModel* model_of(EnvIndex env, std::size_t body) const { return models_[row_of(env, body)]; }  // null: a free slot

  // --- snapshots
  // Visits the configurations that add_model() has added. State::bodies is visited with the state.
  void visit(ArrayVisitor& visitor) { visitor.blob("body_models", added_); }
  // Call it after a restore. Throws std::invalid_argument if what was restored is not valid.
  void restored();
  // Takes State::bodies and the added configurations of a smaller batch, whose envs keep their numbers.
  void copy(const BodyTable& smaller);

  // --- views; valid as long as the table,
  // of all envs; of_env(env, per_env()) selects an env.
  trace::Bodies shapes() const;
  render::VisibleBodies visible() const { return {shapes(), surfaces_.data()}; }
  collision::MovingBodies moving() const;  // during the last tick

 private:
  void drop_unused_models();  // added ones that no slot holds; the others may change their numbers
  const BodyModel* find_model(EnvIndex env, std::int32_t number) const;  // null if there is none
  void place(std::size_t row, const Moment& moment);
  void show(std::size_t row, const BodyModel* model);  // null: nothing
  void stand(std::size_t row);                         // takes the current pose for the one before the last tick
  ScriptKey key_of(EnvIndex env, std::size_t body) const;

  State& state_;
  std::size_t per_env_;
  std::size_t num_configs_;
  double tick_s_;
  std::function<Models(EnvIndex)> models_of_;
  std::vector<std::unique_ptr<const BodyModel>> numbered_;  // models of the configuration, then the added ones
  std::string added_;                                       // the added ones, packed
  // (E B,)
  std::vector<const BodyModel*> models_;
  std::vector<const Primitive*> solids_;
  std::vector<const trace::Scene*> meshes_;
  std::vector<const std::vector<collision::Corners>*> parts_;
  std::vector<render::BodySurface> surfaces_;
  std::vector<float> seen_radius_, reach_;
  std::vector<float> from_position_, from_quat_;  // before the last tick
};

}  // namespace flockstep::bodies
