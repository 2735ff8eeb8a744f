// Operations on all drones or envs at once.
#include <algorithm>
#include <array>
#include <chrono>
#include <string>
#include <utility>

#include "base/require.hpp"
#include "flockstep/task.hpp"
#include "service/service.hpp"

namespace flockstep::server {
namespace {

using protocol::Code;

template <class Enum>
const char* name_of(Enum value) {
  return EnumNames<Enum>::kNames[static_cast<std::size_t>(value)];
}

std::optional<Control> control_of(const std::string& name) {
  if (name.empty()) return std::nullopt;
  constexpr auto& kNames = EnumNames<Control>::kNames;
  std::string known;
  for (const char* const one : kNames) known += (known.empty() ? "" : ", ") + std::string(one);
  const auto found = std::ranges::find(kNames, name);
  require(found != kNames.end(), "control", "one of " + known, '"' + name + '"');
  return static_cast<Control>(found - kNames.begin());
}

protocol::DType message_of(DType type) {
  using enum protocol::DType;
  constexpr std::array kTypes{kDtypeBool, kDtypeUint8, kDtypeInt32, kDtypeInt64, kDtypeFloat32, kDtypeFloat64};
  static_assert(kTypes.size() == EnumNames<DType>::kNames.size());
  return kTypes[static_cast<std::size_t>(type)];
}

std::vector<std::size_t> shape_of(const Field& field, std::size_t rows) {
  std::vector<std::size_t> shape{rows};
  for (const std::int64_t size : field.shape) shape.push_back(static_cast<std::size_t>(size));
  return shape;
}

// True if the drones of an env end their episodes without each other.
bool ends_separately(const Batch& batch) { return !batch.state().own.finished.empty(); }

// Adds the observations, and the rows that take no part in the next step.
void add_observation(protocol::FrameWriter& writer, const Batch& batch) {
  const TaskSpec& spec = batch.spec();
  const std::vector<Buffer>& buffers = batch.outputs().observation;
  const std::size_t rows = batch.outputs().reward.size();
  for (std::size_t i = 0; i < buffers.size(); ++i) {
    const Field& field = spec.observation[i];
    writer.add("observation/" + field.name, message_of(field.type), std::as_bytes(std::span(buffers[i].bytes())),
               shape_of(field, rows));
  }
  const FlagArray waiting = batch.waiting();
  writer.add("waiting", protocol::DType::kDtypeBool, std::as_bytes(std::span(waiting)), std::array{rows});
}

// Adds the results of a step. Statistics of episodes, and final observations, only have the rows whose episode has ended.
void add_step(protocol::FrameWriter& writer, const Batch& batch) {
  const TaskSpec& spec = batch.spec();
  const Outputs& outputs = batch.outputs();
  const bool has_final = batch.config().episode.autoreset_mode == AutoresetMode::same_step;
  const std::size_t rows = outputs.reward.size();
  std::vector<std::size_t> ended;
  for (std::size_t row = 0; row < rows; ++row) {
    if ((outputs.terminated[row] | outputs.truncated[row]) != 0) ended.push_back(row);
  }
  std::size_t row_bytes = 0;
  for (const Buffer& buffer : outputs.observation) row_bytes += buffer.row_bytes();
  const std::size_t statistics_bytes = 32 + sizeof(double) * spec.reward_terms.size();
  writer.reserve(rows * (row_bytes + 9) + ended.size() * (row_bytes + statistics_bytes));
  add_observation(writer, batch);
  const bool adds_final = has_final && !ended.empty();
  for (std::size_t i = 0; adds_final && i < spec.observation.size(); ++i) {
    const Field& field = spec.observation[i];
    writer.add_rows("final_observation/" + field.name, message_of(field.type), outputs.final_observation[i].bytes().data(), ended,
                    shape_of(field, ended.size()));
  }
  for_each_view(outputs, {.sizes = {std::ssize(spec.reward_terms), 1}, .dimensions = 1}, [&](const ArrayView& view) {
    const std::string_view name = view.name;
    if (name == "reward" || name == "terminated" || name == "truncated") {
      add_array(writer, view);
    } else if (name != "reward_terms" && !ended.empty()) {
      add_rows(writer, view, ended);
    }
  });
}

protocol::Field message_of(const Field& field) {
  protocol::Field message;
  message.name = field.name;
  message.dtype = message_of(field.type);
  for (const std::int64_t size : field.shape) message.shape.push_back(static_cast<std::uint64_t>(size));
  message.low = field.low;
  message.high = field.high;
  return message;
}

std::int64_t num_rows(const Batch& batch) {
  return batch.spec().row == Row::drone ? batch.config().num_drones() : batch.config().num_envs;
}

void require_task(const Task* task) {
  if (task == nullptr) throw Refusal(Code::kFailedPrecondition, "this batch has no task: start the server with one");
}

}  // namespace

void Service::read(Call& call, const protocol::GetArrays& get, const ArraySource& arrays) {
  require_sensor(get.sensor);
  std::vector<std::string> missing = get.names;
  arrays.list(get.sensor, [&](const ArrayView& view) {
    if (std::erase(missing, view.name) > 0) add_array(call.writer, view);
  });
  if (!missing.empty()) {
    std::string known;
    arrays.list(get.sensor, [&](const ArrayView& view) { known += (known.empty() ? "" : ", ") + std::string(view.name); });
    refuse("names", "names among " + known, '"' + missing.front() + '"');
  }
  write_time(call);
  auto& time = std::get<protocol::Time>(call.reply.result);
  time.num_envs = arrays.num_envs;
  time.generation = arrays.generation;
}

void Service::locked(Call& call, const protocol::SetPoses& set) {
  const std::int64_t drones = batch_.config().num_drones();
  const auto position = call.array<float>("position", {drones, 3});
  const auto quat = call.array<float>("quat_wxyz", {drones, 4});
  const auto mask = call.flags("mask", {drones});
  require_may_move(set.teleport);
  const std::span<const float> positions = position ? std::span(*position) : std::span<const float>();
  const std::span<const float> rotations = quat ? std::span(*quat) : std::span<const float>();
  const DroneMask selected = mask ? DroneMask(*mask) : DroneMask();
  require_may_change(call, mask ? std::span<const std::uint8_t>(*mask) : std::span<const std::uint8_t>());
  begin_change();
  if (set.teleport) {  // drones keep their attitude; without one, set_pose() would make those with rotors level
    const bool keeps = rotations.empty() && !batch_.config().dynamics.is_kinematic();
    batch_.set_pose(positions, keeps ? std::span<const float>(batch_.state().quat_wxyz) : rotations, selected);
  } else {
    batch_.move(positions, rotations, selected);
  }
  const LiveArrays arrays(batch_);
  for (const char* const name : {"position", "quat_wxyz", "hit", "point", "normal"})
    add_array(call.writer, *arrays.find("", name));
  write_time(call);
}

void Service::locked(Call& call, const protocol::Fly& fly) {
  const std::int64_t drones = batch_.config().num_drones();
  const std::optional<Control> control = control_of(fly.control);
  const auto command = call.given<float>("command", {drones, static_cast<std::int64_t>(batch_.command_size(control))});
  const auto mask = call.flags("mask", {drones});
  require(fly.ticks <= 1000000, "ticks", "an integer in [0, 1000000]", fly.ticks);
  require_may_change(call, mask ? std::span<const std::uint8_t>(*mask) : std::span<const std::uint8_t>());
  begin_change();
  batch_.fly(command, static_cast<int>(fly.ticks), mask ? DroneMask(*mask) : DroneMask(), control);
  write_time(call);
}

void Service::clear_command(std::size_t drone) {
  has_command_[drone] = 0;
  std::fill_n(commands_.begin() + static_cast<std::ptrdiff_t>(command_size() * drone), command_size(), 0.0F);
}

void Service::drop_absent_commands() {
  for (std::size_t drone = 0; drone < has_command_.size(); ++drone) {
    if (has_command_[drone] != 0 && batch_.state().active[drone] == 0) clear_command(drone);
  }
}

void Service::locked(Call& call, const protocol::SetCommand& set) {
  if (batch_.config().dynamics.is_kinematic()) {
    throw Refusal(Code::kFailedPrecondition, "these drones do not fly by rotors: SetLocation and SetPoses move them");
  }
  const std::int64_t drones = batch_.config().num_drones();
  const Control control = control_of(set.control).value_or(batch_.config().dynamics.control);
  require(control != Control::pose, "control", "a control other than pose", "pose");
  drop_absent_commands();
  std::vector<std::uint8_t> mask(static_cast<std::size_t>(drones), 0);
  const auto size = static_cast<std::int64_t>(batch_.command_size(control));
  std::vector<float> commands = commands_;
  if (command_control_ != control) commands.assign(static_cast<std::size_t>(size * drones), 0.0F);
  if (set.drone) {
    const std::size_t drone = require_drone(*set.drone);
    const auto command = call.given<float>("command", {1, size});
    std::ranges::copy(command, commands.begin() + size * static_cast<std::ptrdiff_t>(drone));
    mask[drone] = 1;
  } else {
    const auto command = call.given<float>("command", {drones, size});
    mask = call.flags("mask", {drones}).value_or(std::vector<std::uint8_t>(static_cast<std::size_t>(drones), 1));
    for (std::size_t drone = 0; drone < mask.size(); ++drone) {
      const auto row = size * static_cast<std::ptrdiff_t>(drone);
      if (mask[drone] != 0) std::copy_n(command.begin() + row, size, commands.begin() + row);
    }
  }
  require_may_change(call, mask);
  for (std::size_t drone = 0; drone < mask.size(); ++drone) {
    if (mask[drone] == 0 && has_command_[drone] != 0 && command_control_ != control) {
      throw Refusal(Code::kFailedPrecondition, "control: expected " + std::string(name_of(*command_control_)) +
                                                   ", by which the steps fly drone " + std::to_string(drone) + ", got " +
                                                   name_of(control));
    }
  }
  batch_.require_command(commands, control);
  commands_ = std::move(commands);
  for (std::size_t drone = 0; drone < mask.size(); ++drone) {
    if (mask[drone] != 0) has_command_[drone] = 1;
  }
  command_control_ = control;
}

void Service::locked(Call& call, const protocol::SetClock& set) {
  require(set.rate_hz == 0.0 || (set.rate_hz >= ServerConfig::kMinRateHz && set.rate_hz <= 10000.0), "rate_hz",
          "0 or a number in [1e-06, 10000]", set.rate_hz);
  if (task_ != nullptr) throw Refusal(Code::kFailedPrecondition, "this batch has a task, which actions step");
  if (set.rate_hz > 0.0 && !lockstep_.empty()) throw Refusal(Code::kFailedPrecondition, "clients step in lockstep");
  rate_hz_ = set.rate_hz;
  if (on_new_rate_) on_new_rate_();
  write_time(call);
}

void Service::locked(Call& call, const protocol::Sense&) {
  begin_change();
  batch_.sense();
  write_time(call);
}

void Service::locked(Call& call, const protocol::Snapshot&) {
  std::string bytes = batch_.snapshot();
  largest_snapshot_ = std::max(largest_snapshot_.load(), bytes.size());
  call.writer.add_bytes("snapshot", std::move(bytes));
}

void Service::locked(Call& call, const protocol::Restore&) {
  require_may_change(call, std::span<const std::uint8_t>());
  const std::optional<std::string> bytes = call.take_bytes("snapshot");
  require(bytes.has_value(), "snapshot", "an array of this name", "none");
  begin_change();
  batch_.restore(*bytes);
  if (task_ != nullptr) add_observation(call.writer, batch_);
}

// ------------------------------------------------------------------------------------------------------------------- the task

void Service::now(Call& call, const protocol::GetTask&) {
  require_task(task_);
  const TaskSpec& spec = batch_.spec();
  auto& task = call.result<protocol::Task>();
  task.action = message_of(spec.action);
  for (const Field& field : spec.observation) task.observation.push_back(message_of(field));
  task.reward_terms = spec.reward_terms;
  task.num_rows = num_rows(batch_);
  task.row_is_env = spec.row == Row::env;
  task.autoreset_mode = name_of(batch_.config().episode.autoreset_mode);
  task.policy_hz = batch_.config().clock.policy_hz;
  task.frame_skip = batch_.config().episode.frame_skip;
  task.episodes = name_of(ends_separately(batch_) ? batch_.config().episode.episodes : Episodes::team);
}

void Service::locked(Call& call, const protocol::ResetEnvs&) {
  require_task(task_);
  require_may_change(call, std::span<const std::uint8_t>());
  const std::int64_t envs = batch_.config().num_envs, drones = batch_.config().num_drones();
  const auto seeds = call.array<std::uint64_t>("seeds", {envs});
  auto mask = call.flags("mask", {-1});
  const bool of_drones = mask && !seeds && ends_separately(batch_) && std::ssize(*mask) == drones;
  if (!of_drones) mask = call.flags("mask", {envs});
  begin_change();
  if (of_drones) {
    batch_.reset_drones(DroneMask(*mask));
  } else {
    batch_.reset(seeds ? std::span<const std::uint64_t>(*seeds) : std::span<const std::uint64_t>(),
                 mask ? EnvMask(*mask) : EnvMask());
  }
  add_observation(call.writer, batch_);
  write_time(call);
}

void Service::locked(Call& call, const protocol::StepEnvs&) {
  require_task(task_);
  require_may_change(call, std::span<const std::uint8_t>());
  const TaskSpec& spec = batch_.spec();
  std::vector<std::int64_t> shape{num_rows(batch_)};
  const auto start = std::chrono::steady_clock::now();
  begin_change();
  if (is_floating(spec.action.type)) {
    shape.insert(shape.end(), spec.action.shape.begin(), spec.action.shape.end());
    const auto actions = call.given<float>("actions", shape);
    batch_.step(std::span<const float>(actions));
  } else {
    const auto actions = call.given<std::int64_t>("actions", shape);
    batch_.step(std::span<const std::int64_t>(actions));
  }
  steps_are_short_ = std::chrono::steady_clock::now() - start < std::chrono::milliseconds(1);
  steps_.fetch_add(1, std::memory_order_relaxed);
  rate_.add(1.0, step_s_);
  add_step(call.writer, batch_);
  write_time(call);
}

}  // namespace flockstep::server
