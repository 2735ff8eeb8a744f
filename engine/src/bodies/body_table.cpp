#include "bodies/body_table.hpp"

#include <algorithm>
#include <utility>

#include "base/packed_fields.hpp"
#include "base/pose_access.hpp"
#include "base/require.hpp"

namespace flockstep::bodies {
namespace {

constexpr std::int32_t kNone = -1;
constexpr float kReachRounding = 1.00001F;

// Models of a world have the numbers -2, -3, ...
constexpr std::int32_t number_in_world(std::size_t model) { return -2 - static_cast<std::int32_t>(model); }

// Moves with constant velocity for a time.
Pose moved(const Pose& pose, const Velocity& velocity, double time_s) {
  const Eigen::Vector3d turn = time_s * velocity.angular.cast<double>();
  const double angle = turn.norm();
  Pose result{(pose.position.cast<double>() + time_s * velocity.linear.cast<double>()).cast<float>(), pose.rotation};
  if (angle > 0.0) {
    const Eigen::Quaterniond by(Eigen::AngleAxisd(angle, turn / angle));
    result.rotation = (pose.rotation.cast<double>() * by).normalized().cast<float>();
  }
  return result;
}

}  // namespace

BodyTable::BodyTable(State& state, const std::vector<BodyConfig>& configs, std::size_t per_env, double tick_s,
                     std::function<Models(EnvIndex)> models_of)
    : state_(state),
      per_env_(per_env),
      num_configs_(configs.size()),
      tick_s_(tick_s),
      models_of_(std::move(models_of)),
      models_(state.bodies.active.size()),
      solids_(models_.size()),
      meshes_(models_.size()),
      parts_(models_.size()),
      surfaces_(models_.size()),
      seen_radius_(models_.size(), -1.0F),
      reach_(models_.size(), -1.0F),
      from_position_(3 * models_.size()),
      from_quat_(4 * models_.size()) {
  for (const BodyConfig& config : configs) numbered_.push_back(std::make_unique<BodyModel>(config));
  for (std::size_t row = 0; row < models_.size(); ++row) {
    state_.bodies.model[row] = kNone;
    place(row, {});
  }
}

void BodyTable::begin(EnvIndex env) {
  const std::size_t of_world = models_of_(env).size();
  for (std::size_t body = 0; body < per_env_; ++body) {
    if (body < of_world) {
      put(env, body, number_in_world(body));
    } else if (body < of_world + num_configs_) {
      put(env, body, static_cast<std::int32_t>(body - of_world));
    } else {
      remove(env, body);
    }
  }
}

void BodyTable::advance(EnvIndex env, std::int64_t tick) {
  BodyState& bodies = state_.bodies;
  bool changes = false;
  for (std::size_t body = 0; body < per_env_; ++body) {
    const std::size_t row = row_of(env, body);
    const BodyModel* const model = models_[row];
    if (model == nullptr) continue;
    Moment moment;
    if (bodies.scripted[row]) {
      if (!model->script.moves()) continue;
      moment = model->script.at(static_cast<double>(tick) * tick_s_, key_of(env, body));
    } else {
      moment.velocity = {Vec3::Map(bodies.velocity.data() + 3 * row), Vec3::Map(bodies.angular_velocity.data() + 3 * row)};
      if (moment.velocity.linear.isZero(0.0F) && moment.velocity.angular.isZero(0.0F)) {
        stand(row);
        continue;
      }
      moment.pose =
          moved(load_pose(bodies.position.data() + 3 * row, bodies.quat_wxyz.data() + 4 * row), moment.velocity, tick_s_);
    }
    changes |= seen_radius_[row] >= 0.0F;
    if (!is_in_world(moment.pose.position)) {
      remove(env, body);
      continue;
    }
    stand(row);
    place(row, moment);
    if (reach_[row] < 0.0F) continue;
    const Vec3 way = Vec3::Map(bodies.position.data() + 3 * row) - Vec3::Map(from_position_.data() + 3 * row);
    reach_[row] = (model->radius + way.norm()) * kReachRounding;
  }
  if (changes) ++bodies.changes[env];
}

std::int32_t BodyTable::add_model(const BodyConfig& config) {
  FieldPacker wanted;
  wanted.add(config);
  for (std::size_t number = 0; number < numbered_.size(); ++number) {
    FieldPacker known;
    known.add(numbered_[number]->config);
    if (known.bytes() == wanted.bytes()) return static_cast<std::int32_t>(number);
  }
  auto model = std::make_unique<BodyModel>(config);
  if (numbered_.size() - num_configs_ > 2 * models_.size()) drop_unused_models();
  std::string added = added_ + wanted.bytes();
  numbered_.push_back(std::move(model));
  added_.swap(added);
  return static_cast<std::int32_t>(numbered_.size()) - 1;
}

void BodyTable::drop_unused_models() {
  std::vector<std::int32_t> numbers(numbered_.size(), kNone);  // by the current numbers
  for (const std::int32_t number : state_.bodies.model) {
    if (number >= 0) numbers[static_cast<std::size_t>(number)] = number;
  }
  FieldPacker added;
  std::size_t count = num_configs_;
  for (std::size_t number = num_configs_; number < numbers.size(); ++number) {
    if (numbers[number] == kNone) continue;
    added.add(numbered_[number]->config);
    numbers[number] = static_cast<std::int32_t>(count++);
  }
  added_ = added.bytes();
  for (std::size_t number = num_configs_; number < numbers.size(); ++number) {
    if (numbers[number] != kNone) std::swap(numbered_[static_cast<std::size_t>(numbers[number])], numbered_[number]);
  }
  numbered_.resize(count);
  for (std::int32_t& number : state_.bodies.model) {
    if (number >= 0) number = numbers[static_cast<std::size_t>(number)];
  }
}

void BodyTable::put(EnvIndex env, std::size_t body, std::int32_t model) {
  const std::size_t row = row_of(env, body);
  state_.bodies.model[row] = model;
  state_.bodies.active[row] = state_.bodies.scripted[row] = 1;
  show(row, find_model(env, model));
  place(row, models_[row]->script.at(static_cast<double>(state_.tick[env]) * tick_s_, key_of(env, body)));
  stand(row);
  ++state_.bodies.changes[env];
}

void BodyTable::remove(EnvIndex env, std::size_t body) {
  const std::size_t row = row_of(env, body);
  if (!state_.bodies.active[row]) return;
  state_.bodies.model[row] = kNone;
  state_.bodies.active[row] = state_.bodies.scripted[row] = 0;
  show(row, nullptr);
  place(row, {});
  stand(row);
  ++state_.bodies.changes[env];
}

void BodyTable::set_pose(EnvIndex env, std::size_t body, const Pose& pose) {
  const std::size_t row = row_of(env, body);
  BodyState& bodies = state_.bodies;
  store_pose(bodies.position.data() + 3 * row, bodies.quat_wxyz.data() + 4 * row, pose);
  bodies.scripted[row] = 0;
  stand(row);
  ++bodies.changes[env];
}

void BodyTable::set_velocity(EnvIndex env, std::size_t body, const Velocity& velocity) {
  const std::size_t row = row_of(env, body);
  std::copy_n(velocity.linear.data(), 3, state_.bodies.velocity.data() + 3 * row);
  std::copy_n(velocity.angular.data(), 3, state_.bodies.angular_velocity.data() + 3 * row);
  state_.bodies.scripted[row] = 0;
}

void BodyTable::restored() {
  std::vector<std::unique_ptr<const BodyModel>> added;
  FieldUnpacker reader(added_, "snapshot: body_models");
  while (!reader.at_end()) {
    BodyConfig config;
    reader.take(config);
    added.push_back(std::make_unique<BodyModel>(config));
  }
  numbered_.resize(num_configs_);
  std::ranges::move(added, std::back_inserter(numbered_));
  for (std::size_t row = 0; row < models_.size(); ++row) {
    const std::int32_t number = state_.bodies.model[row];
    const BodyModel* const model = find_model(EnvIndex(row / per_env_), number);
    require((model != nullptr) == (state_.bodies.active[row] != 0) && (model != nullptr || number == kNone),
            "snapshot: body_model", "a model for each active body", number);
    show(row, model);
    stand(row);
  }
}

void BodyTable::copy(const BodyTable& smaller) {
  for_each_listed(state_.bodies, [&](const auto& entry, auto& values) {
    std::ranges::copy(smaller.state_.bodies.*entry.member, values.begin());
  });
  added_ = smaller.added_;
  restored();
}

trace::Bodies BodyTable::shapes() const {
  return {.position = state_.bodies.position.data(),
          .quat_wxyz = state_.bodies.quat_wxyz.data(),
          .radius = seen_radius_.data(),
          .solids = solids_.data(),
          .meshes = meshes_.data(),
          .count = models_.size()};
}

collision::MovingBodies BodyTable::moving() const {
  return {.from_position = from_position_.data(),
          .from_quat = from_quat_.data(),
          .position = state_.bodies.position.data(),
          .quat_wxyz = state_.bodies.quat_wxyz.data(),
          .reach = reach_.data(),
          .solids = solids_.data(),
          .parts = parts_.data(),
          .count = models_.size()};
}

const BodyModel* BodyTable::find_model(EnvIndex env, std::int32_t number) const {
  if (number >= 0)
    return static_cast<std::size_t>(number) < numbered_.size() ? numbered_[static_cast<std::size_t>(number)].get() : nullptr;
  if (number == kNone) return nullptr;
  const Models of_world = models_of_(env);
  const std::size_t model = static_cast<std::size_t>(-2 - std::int64_t{number});
  return model < of_world.size() ? &of_world[model] : nullptr;
}

void BodyTable::place(std::size_t row, const Moment& moment) {
  BodyState& bodies = state_.bodies;
  store_pose(bodies.position.data() + 3 * row, bodies.quat_wxyz.data() + 4 * row, moment.pose);
  std::copy_n(moment.velocity.linear.data(), 3, bodies.velocity.data() + 3 * row);
  std::copy_n(moment.velocity.angular.data(), 3, bodies.angular_velocity.data() + 3 * row);
}

void BodyTable::show(std::size_t row, const BodyModel* model) {
  models_[row] = model;
  const bool is_there = model != nullptr;
  solids_[row] = is_there ? &model->solid : nullptr;
  meshes_[row] = is_there ? model->mesh : nullptr;
  parts_[row] = is_there ? model->parts : nullptr;
  surfaces_[row] = is_there ? model->surface : render::BodySurface();
  seen_radius_[row] = is_there && is_visible(model->config.visibility) ? model->radius : -1.0F;
  reach_[row] = is_there && is_solid(model->config.visibility) ? model->radius : -1.0F;
}

void BodyTable::stand(std::size_t row) {
  std::copy_n(state_.bodies.position.data() + 3 * row, 3, from_position_.data() + 3 * row);
  std::copy_n(state_.bodies.quat_wxyz.data() + 4 * row, 4, from_quat_.data() + 4 * row);
  if (reach_[row] >= 0.0F) reach_[row] = models_[row]->radius;
}

ScriptKey BodyTable::key_of(EnvIndex env, std::size_t body) const {
  return {state_.seed[env], state_.episode[env], static_cast<std::uint32_t>(body)};
}

}  // namespace flockstep::bodies
