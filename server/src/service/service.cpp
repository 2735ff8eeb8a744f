#include "service/service.hpp"

#include <algorithm>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>

#include "base/require.hpp"
#include "flockstep/version.hpp"
#include "service/convert.hpp"

namespace flockstep::server {
namespace {

using protocol::Code;

template <class Operation>
const std::string& sensor_of(const Operation& operation) {
  static const std::string kNone;
  if constexpr (requires { operation.sensor; }) {
    return operation.sensor;
  } else {
    return kNone;
  }
}

const char* name_of(Rows rows) {
  switch (rows) {
    case Rows::drone:
      return "drone";
    case Rows::env:
      return "env";
    case Rows::task:
      return "task";
    case Rows::body:
      return "body";
  }
  return "";
}

}  // namespace

Service::Service(Batch& batch, const ServerConfig& config, Post post, Post run_aside, Post run_compression, Workload& workload)
    : batch_(batch),
      task_(batch.task()),
      config_(config),
      run_aside_(std::move(run_aside)),
      run_compression_(std::move(run_compression)),
      workload_(workload),
      step_s_(1.0 / static_cast<double>(batch.config().clock.policy_hz)),
      executor_(std::move(post)),
      rate_hz_(config.rate_hz) {
  const BatchLock lock(batch_);
  require(!ServedBatch::is_served(batch_), "batch", "one that no server serves",
          "one that another server serves: stop that one first");
  require(config.rate_hz == 0.0 || task_ == nullptr, "rate_hz", "0 for a batch with a task, which actions step", config.rate_hz);
  refresh_info();
  served_.emplace(batch_, [this] {
    count_program_steps();
    begin_change();
  });
}

Service::~Service() { unshare(); }

void Service::unshare() {
  if (served_) served_->end();
}

void Service::refresh_info() {
  const BatchConfig& config = batch_.config();
  const bool has_grown = !info_ || info_->generation != ServedBatch::generation(batch_);
  if (info_ && info_->drones_per_env != config.drones_per_env) renumber(config.drones_per_env);
  auto next = std::make_shared<BatchInfo>();
  next->protocol = protocol::kVersion;
  next->version = FLOCKSTEP_VERSION;
  next->flies_by_rotors = !config.dynamics.is_kinematic();
  next->control = EnumNames<Control>::kNames[static_cast<std::size_t>(config.dynamics.control)];
  next->num_rotors = static_cast<std::int64_t>(batch_.num_rotors());
  next->has_task = task_ != nullptr;
  next->step_s = step_s_;
  next->num_envs = config.num_envs;
  next->drones_per_env = config.drones_per_env;
  next->bodies_per_env = static_cast<std::int64_t>(batch_.bodies().per_env());
  next->generation = ServedBatch::generation(batch_);
  next->sensors = sensor_names(config);
  for (const LidarConfig& lidar : config.lidars) next->lidars.push_back(lidar.name);
  for (const auto& imu : config.imus) {
    next->imus.push_back(imu.name);
    next->imu_config_json.push_back(json_of(imu).dump());
  }
  for (std::size_t camera = 0; camera < config.cameras.size(); ++camera) {
    next->camera_configs.push_back(batch_.camera(camera).config());
    next->cameras.push_back(next->camera_configs.back().name);
  }
  next->worlds = batch_.worlds();
  std::size_t bytes = 0, rays = 0;
  const auto count = [&](const ArrayView& view) { bytes += view.size * view.value_size; };
  list_arrays(batch_, "", [&](const ArrayView& view) {
    next->array_names.emplace_back(view.name);
    next->array_rows.emplace_back(name_of(view.info.rows));
    count(view);
  });
  for (const LidarConfig& lidar : config.lidars) {
    rays = std::max(rays, static_cast<std::size_t>(lidar.rows()) * static_cast<std::size_t>(lidar.columns()));
  }
  for (const std::string& sensor : next->sensors) {
    if (std::ranges::find(next->cameras, sensor) == next->cameras.end()) list_arrays(batch_, sensor, count);
  }
  next->max_snapshot_bytes = max_snapshot_bytes(bytes);
  constexpr std::size_t kFewBytes = std::size_t{1} << 20, kFewRays = std::size_t{1} << 12;
  is_small_ = bytes <= kFewBytes && rays <= kFewRays;
  {
    const std::scoped_lock lock(shape_mutex_);
    info_ = std::move(next);
  }
  if (has_grown) fit_rows();
}

std::size_t Service::max_snapshot_bytes(std::size_t array_bytes) const {
  constexpr std::size_t kSpare = std::size_t{1} << 26;          // for the state of a task
  constexpr std::size_t kBytesPerDrone = std::size_t{1} << 10;  // settings of its sensors and of the task
  if (task_ != nullptr) {
    for (const auto* const buffers : {&batch_.outputs().observation, &batch_.outputs().final_observation}) {
      for (const Buffer& buffer : *buffers) array_bytes += buffer.bytes().size();
    }
  }
  return 2 * array_bytes + kBytesPerDrone * static_cast<std::size_t>(batch_.config().num_drones()) + kSpare;
}

std::shared_ptr<const Service::BatchInfo> Service::info() const {
  const std::scoped_lock lock(shape_mutex_);
  return info_;
}

void Service::welcome(Call& call) {
  const auto& hello = std::get<protocol::Hello>(call.request.operation);
  guard(call, [&] {
    if (hello.protocol != protocol::kVersion) {
      throw Refusal(Code::kFailedPrecondition, "protocol: expected version " + std::to_string(protocol::kVersion) +
                                                   ", which this server (flockstep " FLOCKSTEP_VERSION ") has, got " +
                                                   std::to_string(hello.protocol) + "; install the same version on both sides");
    }
    {
      const std::scoped_lock lock(owners_mutex_);
      call.client->number = ++last_client_;
    }
    auto& welcome = call.result<protocol::Welcome>() = *info();
    welcome.client = call.client->number;
  });
}

// -------------------------------------------------------------------------------------------------------- ways to run a call

void Service::answer(const std::shared_ptr<Call>& call) {
  std::visit([&](const auto& operation) { handle(call, operation); }, call->request.operation);
}

template <class Operation>
void Service::handle(const std::shared_ptr<Call>& call, const Operation& operation) {
  if constexpr (requires { now(*call, operation); }) {
    guard(*call, [&] {
      call->require_listed();
      now(*call, operation);
    });
    complete(call);
  } else if constexpr (requires { aside(*call, operation); }) {
    run_aside_([this, call] {
      guard(*call, [&] {
        call->require_listed();
        aside(*call, std::get<Operation>(call->request.operation));
      });
      complete(call);
    });
  } else if constexpr (requires(const ArraySource& arrays) { read(*call, operation, arrays); }) {
    const auto reply = [&](const auto& read_now) {
      std::optional<Workload::Mark> mark;
      if (!is_small_) mark.emplace(workload_);
      guard(*call, read_now);
      complete(call);
    };
    const bool done = executor_.try_run([&] {
      const std::optional<BatchLock> lock = BatchLock::try_lock(batch_);
      if (!lock) return false;
      reply([&] {
        follow_program();
        read(*call, operation, LiveArrays(batch_));
      });
      return true;
    });
    if (done) return;
    const std::string& sensor = sensor_of(operation);
    try {
      require_sensor(sensor);
    } catch (const std::invalid_argument& error) {
      call->fail(Code::kInvalidArgument, error.what());
      return complete(call);
    }
    if (const auto copy = publisher_.read(batch_, sensor)) return reply([&] { read(*call, operation, *copy); });
    run_locked(call, is_small_,
               [this](Call& waited) { read(waited, std::get<Operation>(waited.request.operation), LiveArrays(batch_)); });
  } else if constexpr (requires { locked(*call, operation); }) {
    const bool is_short =
        std::is_same_v<Operation, protocol::StepEnvs> ? steps_are_short_.load() : protocol::kIsShort<Operation> && is_small_;
    run_locked(call, is_short, [this](Call& waited) {
      waited.require_listed();
      locked(waited, std::get<Operation>(waited.request.operation));
    });
  } else {
    call->fail(Code::kUnimplemented, std::is_same_v<Operation, std::monostate>
                                         ? "operation: this server does not have the operation of this request"
                                         : "operation: not possible here");
    complete(call);
  }
}

Service::Hold::Hold(Service& service, bool is_short) : lock_(is_short ? BatchLock::try_lock(service.batch_) : std::nullopt) {
  if (lock_) return;
  mark_.emplace(service.workload_);
  lock_.emplace(service.batch_);
}

void Service::run_locked(const std::shared_ptr<Call>& call, bool is_short, std::function<void(Call&)> operation) {
  executor_.run([this, call, is_short, operation = std::move(operation)] {
    guard(*call, [&] {
      const Hold hold(*this, is_short);
      follow_program();
      operation(*call);
    });
    complete(call);
  });
}

void Service::complete(const std::shared_ptr<Call>& call) {
  answered_.fetch_add(1, std::memory_order_relaxed);
  try {
    call->finish();
  } catch (const std::exception&) {
    call->fail(Code::kResourceExhausted, "the server has not enough memory for this reply");
    call->finish();
  }
  call->client->deliver(call);
}

std::size_t Service::max_array_bytes(const protocol::Request& request) {
  if (request.arrays.empty()) return 0;
  follow_program_if_free();
  const auto now = info();
  const auto sizes = [&](std::string_view name) -> std::size_t {
    const auto drones = static_cast<std::size_t>(now->num_drones()), envs = static_cast<std::size_t>(now->num_envs);
    if (name == "E") return envs;
    if (name == "B")
      return std::max<std::size_t>(static_cast<std::size_t>(now->bodies_per_env), 1);  // a mask may be that of envs
    if (name == "N") return std::max<std::size_t>(drones, 1);
    if (name == "E or N") return std::max(envs, drones);
    if (name == "C") return kMaxRotors;  // a command
    if (name == "action") return task_ == nullptr ? 0 : batch_.spec().action.size();
    if (name == "size") return std::max(now->max_snapshot_bytes, 2 * largest_snapshot_);
    return static_cast<std::size_t>(std::stoul(std::string(name)));
  };
  std::size_t bytes = 0;
  for (const protocol::RequestArray& array : protocol::arrays_of(request)) {
    std::size_t of_array = protocol::size_of(array.dtype);
    for (const std::string_view name : array.shape) of_array *= sizes(name);
    bytes += of_array;
  }
  return bytes;
}

void Service::leave(const std::shared_ptr<Client>& client) {
  // After the operation that is running: it may be of this client and claim a drone.
  executor_.run([this, client] {
    {
      const std::scoped_lock lock(owners_mutex_);
      std::erase_if(owners_, [&](const auto& entry) { return entry.second == client->number; });
    }
    late_.erase(client->number);
    if (lockstep_.erase(client.get()) > 0) step_if_all_wait();
  });
}

// ------------------------------------------------------------------------------------------------------------------------ time

void Service::follow_program() {
  bool has_changed = ServedBatch::generation(batch_) != info_->generation || batch_.worlds() != info_->worlds;
  for (std::size_t camera = 0; camera < info_->camera_configs.size(); ++camera) {
    has_changed |= batch_.camera(camera).config().capture_mode != info_->camera_configs[camera].capture_mode;
  }
  if (has_changed) refresh_info();
}

void Service::follow_program_if_free() {
  if (const std::optional<BatchLock> lock = BatchLock::try_lock(batch_)) follow_program();
}

void Service::begin_change() {
  changes_.fetch_add(1, std::memory_order_relaxed);
  publisher_.publish(batch_, steps());
}

void Service::count_program_steps() {
  if (batch_.state().tick.empty()) return;
  const std::int64_t tick = batch_.state().tick[0], ticks = tick - std::exchange(last_tick_, tick);
  if (ticks <= 0) return;  // a new episode
  const double steps = static_cast<double>(ticks) / batch_.config().clock.substeps();
  rate_.add(steps, steps * step_s_);
}

void Service::advance() {
  follow_program();
  drop_absent_commands();
  begin_change();
  if (std::ranges::count(has_command_, 1) > 0) batch_.fly(commands_, 0, has_command_, command_control_);
  batch_.sense();
  if (!batch_.state().tick.empty()) last_tick_ = batch_.state().tick[0];
  steps_.fetch_add(1, std::memory_order_relaxed);
  rate_.add(1.0, step_s_);
}

void Service::write_time(Call& call) const {
  auto& time = call.result<protocol::Time>();
  time.step = steps();
  time.time_s = static_cast<double>(steps()) * step_s_;
  const auto now = info();
  time.num_envs = now->num_envs;
  time.generation = now->generation;
}

void Service::tick() {
  if (is_tick_waiting_.exchange(true)) return;
  executor_.run([this] {
    is_tick_waiting_ = false;
    if (rate_hz() == 0.0) return;
    try {
      const Hold hold(*this, false);
      advance();
    } catch (const std::exception& error) {
      rate_hz_ = 0.0;
      if (on_clock_failure_) on_clock_failure_(error.what());
    }
  });
}

void Service::handle(const std::shared_ptr<Call>& call, const protocol::Step&) {
  executor_.run([this, call] {
    bool waits = false;
    guard(*call, [&] {
      if (task_ != nullptr) {
        throw Refusal(Code::kFailedPrecondition, "this batch has a task, which actions step: use StepEnvs");
      }
      if (rate_hz() > 0.0)
        throw Refusal(Code::kFailedPrecondition, "the server steps by itself; SetClock with rate_hz=0 ends that");
      if (!lockstep_.empty()) {
        const auto member = lockstep_.find(call->client.get());
        if (late_.contains(call->client->number)) {
          std::ostringstream text;
          text << "this client has left the lockstep, because the others waited " << config_.lockstep_timeout_s
               << " s (lockstep_timeout_s) for its step: send JoinLockstep again";
          throw Refusal(Code::kFailedPrecondition, text.str());
        }
        if (member == lockstep_.end()) {
          throw Refusal(Code::kFailedPrecondition, "other clients step in lockstep: send JoinLockstep first");
        }
        if (member->second != nullptr) throw Refusal(Code::kFailedPrecondition, "a step of this client is still waiting");
        member->second = call;
        waits = true;
        return;
      }
      const Hold hold(*this, false);
      advance();
      write_time(*call);
    });
    if (waits) {
      call->reply = {};
      const auto waiting = std::ranges::count_if(lockstep_, [](const auto& member) { return member.second != nullptr; });
      step_if_all_wait();
      if (waiting == 1 && lockstep_.size() > 1 && on_lockstep_wait_) on_lockstep_wait_(++lockstep_wait_);
    } else {
      complete(call);
    }
  });
}

void Service::step_if_all_wait() {
  const auto is_missing = [](const auto& member) { return member.second == nullptr; };
  if (lockstep_.empty() || std::ranges::any_of(lockstep_, is_missing)) return;
  std::vector<std::shared_ptr<Call>> calls;
  for (auto& [client, call] : lockstep_) calls.push_back(std::exchange(call, nullptr));
  std::string failure;
  try {
    const Hold hold(*this, false);
    advance();
  } catch (const std::exception& error) {
    failure = error.what();
  }
  for (const auto& call : calls) {
    if (failure.empty()) {
      write_time(*call);
    } else {
      call->fail(Code::kFailedPrecondition, failure);
    }
    complete(call);
  }
}

void Service::end_lockstep_wait(std::uint64_t wait) {
  executor_.run([this, wait] {
    const auto is_missing = [](const auto& member) { return member.second == nullptr; };
    if (wait != lockstep_wait_ || std::ranges::all_of(lockstep_, is_missing)) return;
    for (const auto& [client, call] : lockstep_) {
      if (call == nullptr) late_.insert(client->number);
    }
    std::erase_if(lockstep_, is_missing);
    step_if_all_wait();
  });
}

void Service::handle(const std::shared_ptr<Call>& call, const protocol::JoinLockstep&) {
  executor_.run([this, call] {
    guard(*call, [&] {
      if (rate_hz() > 0.0)
        throw Refusal(Code::kFailedPrecondition, "the server steps by itself; SetClock with rate_hz=0 ends that");
      lockstep_.try_emplace(call->client.get(), nullptr);
      late_.erase(call->client->number);
      write_time(*call);
    });
    complete(call);
  });
}

void Service::handle(const std::shared_ptr<Call>& call, const protocol::LeaveLockstep&) {
  executor_.run([this, call] {
    guard(*call, [&] {
      lockstep_.erase(call->client.get());
      late_.erase(call->client->number);
    });
    complete(call);
    step_if_all_wait();
  });
}

// ---------------------------------------------------------------------------------------------------------------------- checks

std::size_t Service::require_drone(std::int64_t drone) const {
  const std::int64_t count = batch_.config().num_drones();
  if (drone < 0 || drone >= count || batch_.state().active[static_cast<std::size_t>(drone)] == 0) {
    throw Refusal(Code::kNotFound, "drone: expected the index of an active drone, got " + std::to_string(drone) +
                                       (drone < 0 || drone >= count ? "; the batch has " + std::to_string(count) + " slots"
                                                                    : ", which is removed"));
  }
  return static_cast<std::size_t>(drone);
}

void Service::require_may_change(const Call& call, std::int64_t drone) const {
  if (!config_.ownership) return;
  const std::scoped_lock lock(owners_mutex_);
  const auto owner = owners_.find(drone);
  if (owner == owners_.end() || owner->second == call.client->number) return;
  throw Refusal(Code::kPermissionDenied,
                "drone " + std::to_string(drone) + " is claimed by client " + std::to_string(owner->second));
}

void Service::require_may_change(const Call& call, std::span<const std::uint8_t> mask) const {
  if (!config_.ownership) return;
  std::vector<std::int64_t> claimed;
  {
    const std::scoped_lock lock(owners_mutex_);
    for (const auto& [drone, owner] : owners_) claimed.push_back(drone);
  }
  for (const std::int64_t drone : claimed) {
    if (mask.empty() || mask[static_cast<std::size_t>(drone)] != 0) require_may_change(call, drone);
  }
}

void Service::require_sensor(const std::string& name) const {
  if (name.empty()) return;
  const auto now = info();
  require(std::ranges::find(now->sensors, name) != now->sensors.end(), "sensor", "the name of a sensor of this batch",
          '"' + name + '"');
}

std::shared_ptr<const World> Service::world(std::uint32_t index) const {
  const auto now = info();
  if (index < now->worlds.size()) return now->worlds[index];
  throw Refusal(Code::kNotFound,
                "world: expected an index below " + std::to_string(now->worlds.size()) + ", got " + std::to_string(index));
}

void Service::renumber(std::int64_t drones_per_env) {
  const std::int64_t before = info_->drones_per_env, count = info_->num_drones();
  if (before == 0) return;
  const auto moved = [&](std::int64_t drone) { return drone / before * drones_per_env + drone % before; };
  const auto size = static_cast<std::size_t>(info_->num_envs * drones_per_env);
  const auto length = static_cast<std::int64_t>(command_size());
  std::vector<float> commands(command_size() * size);
  std::vector<std::uint8_t> has_command(size);
  for (std::int64_t drone = 0; drone < count; ++drone) {
    std::copy_n(commands_.begin() + length * drone, length, commands.begin() + length * moved(drone));
    has_command[static_cast<std::size_t>(moved(drone))] = has_command_[static_cast<std::size_t>(drone)];
  }
  commands_ = std::move(commands);
  has_command_ = std::move(has_command);
  const std::scoped_lock lock(owners_mutex_);
  std::map<std::int64_t, std::uint32_t> owners;
  for (const auto& [drone, owner] : owners_) owners.emplace(moved(drone), owner);
  owners_ = std::move(owners);
}

void Service::fit_rows() {
  const auto drones = static_cast<std::size_t>(batch_.config().num_drones());
  positions_.assign(3 * drones, 0.0F);
  rotations_.assign(4 * drones, 0.0F);
  for (std::size_t drone = 0; drone < drones; ++drone) rotations_[4 * drone] = 1.0F;
  mask_.assign(drones, 0);
  commands_.resize(command_size() * drones, 0.0F);
  has_command_.resize(drones, 0);
}

std::span<const std::uint8_t> Service::only(std::size_t drone) {
  std::ranges::fill(mask_, std::uint8_t{0});
  mask_[drone] = 1;
  return mask_;
}

}  // namespace flockstep::server
