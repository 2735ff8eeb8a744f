#include "batch/snapshot.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <functional>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "base/hash.hpp"
#include "base/require.hpp"
#include "batch/checks.hpp"

namespace flockstep {
namespace {

constexpr std::uint64_t kMagic = 0x504554534b434f4cULL;  // "LOCKSTEP"
constexpr std::uint64_t kFormat = 18;                    // format of a snapshot; increment with each change

struct Header {
  std::uint64_t magic, format, config, length, checksum;
};

std::uint64_t checksum_of(Header header, std::string_view body) {
  header.checksum = 0;
  Hash hash;
  hash.add(std::as_bytes(std::span(&header, 1)));
  hash.add(body);
  return hash.value();
}

template <class F>
void for_each_sensor(Simulation& sim, const F& f) {
  for (const auto& sensor : sim.suite) f(*sensor);
  for (std::size_t camera = 0; camera < sim.cameras.size(); ++camera) f(sim.cameras[camera]);
}

// Adds the hash of each part of the configuration. A field of a struct is a part of its own.
template <class Value>
void add_parts(std::vector<ConfigPart>& parts, const std::string& name, const Value& value) {
  if constexpr (HasFields<Value>) {
    for_each_field(value, [&](const auto& field, const auto& part) {
      if (field.info.affects_hash == AffectsHash::no) return;
      add_parts(parts, (name.empty() ? name : name + '.') + field.name, part);
    });
  } else {
    Hash hash;
    hash.add(value);
    parts.push_back({name, hash.value()});
  }
}

std::vector<ConfigPart> parts_of(const Simulation& sim) {
  std::vector<ConfigPart> parts;
  add_parts(parts, "", sim.config);
  const auto add = [&](const char* name, const auto& describe) {
    Hash hash;
    describe(hash);
    parts.push_back({name, hash.value()});
  };
  add("task", [&](Hash& hash) {
    if (!sim.task_state) return;
    hash.add(sim.task_state->task->identity());
    hash.add(sim.task_state->spec());
  });
  add("max_episode_steps", [&](Hash& hash) {
    if (sim.task_state) hash.add(sim.task_state->max_episode_steps);
  });
  add("worlds or their light", [&](Hash& hash) {
    if (sim.pool) {  // its worlds are not known yet; a snapshot holds the hashes of the current worlds
      hash.add("pool");
      hash.add(sim.pool->pool.size);
      hash.add(sim.pool->pool.fresh);
    } else {
      for (const auto& world : sim.worlds) hash.add(world->content_hash());
    }
  });
  add("drone", [&](Hash& hash) {
    for (const Vec3& vertex : sim.drone_model.hull()) hash.add(std::array{vertex.x(), vertex.y(), vertex.z()});
    if (!sim.fleet) return;
    for (const Airframe& airframe : sim.fleet->airframes) hash.add(airframe);
  });
  return parts;
}

// Returns the parts, which are computed when first needed, since worlds can be large.
const std::vector<ConfigPart>& config_parts(Simulation& sim) {
  if (sim.config_parts.empty()) sim.config_parts = parts_of(sim);
  return sim.config_parts;
}

std::vector<std::uint64_t> hashes_of(const std::vector<ConfigPart>& parts) {
  std::vector<std::uint64_t> hashes;
  for (const ConfigPart& part : parts) hashes.push_back(part.hash);
  return hashes;
}

std::uint64_t config_hash(Simulation& sim) {
  Hash hash;
  hash.add(hashes_of(config_parts(sim)));
  return hash.value();
}

// Visits everything that a snapshot holds except the arrays of the task, in order.
void visit_own(Simulation& sim, ArrayVisitor& visitor) {
  visitor.fields(sim.state);
  if (sim.fleet && sim.fleet->airframes.size() > 1) visitor.array("airframe_index", sim.fleet->airframe_index);
  if (sim.fleet && !sim.fleet->commands.empty()) sim.fleet->commands.visit(visitor);
  if (sim.pool) visitor.array("world_content", sim.pool->contents);
  if (sim.bodies) sim.bodies->visit(visitor);
  sim.lights.visit(visitor);
  for_each_sensor(sim, [&](sensors::Sensor& sensor) { sensor.visit(visitor); });
  if (!sim.task_state) return;
  visitor.fields(sim.episodes);
  visitor.bytes("actions", sim.task_state->actions.bytes(), sim.task_state->actions.type());
  visitor.fields(sim.outputs.now());
  if (sim.task_state->memory) sim.task_state->memory->visit(visitor);
}

void visit(Simulation& sim, ArrayVisitor& visitor) {
  visit_own(sim, visitor);
  if (sim.task_state) sim.task_state->task->visit(visitor);
}

class Writer final : public ArrayVisitor {
 public:
  explicit Writer(std::string& to) : to_(to) {}
  void bytes(std::string_view, std::span<std::byte> bytes, std::optional<DType>) override { write(bytes.data(), bytes.size()); }
  void blob(std::string_view, std::string& bytes) override { write(bytes.data(), bytes.size()); }

 private:
  void write(const void* data, std::size_t count) {
    const auto length = static_cast<std::uint64_t>(count);
    to_.append(reinterpret_cast<const char*>(&length), sizeof(length));
    to_.append(static_cast<const char*>(data), count);
  }
  std::string& to_;
};

// Reads a snapshot without changing anything. apply() then copies the arrays to their places.
class Reader final : public ArrayVisitor {
 public:
  explicit Reader(std::string_view body) : left_(body) {}

  void bytes(std::string_view name, std::span<std::byte> to, std::optional<DType>) override {
    const std::string_view from = next(name);
    require(from.size() == to.size(), "snapshot", std::to_string(to.size()) + " bytes of " + std::string(name), from.size());
    arrays_.push_back({name, from});
    changes_.push_back([to, from] { std::ranges::copy(std::as_bytes(std::span(from)), to.begin()); });
  }
  void blob(std::string_view name, std::string& to) override {
    const std::string_view from = next(name);
    changes_.push_back([&to, from] { to = from; });
  }
  std::string_view left() const { return left_; }
  void require_end() const { require(left_.empty(), "snapshot", "no bytes after its last array", left_.size()); }

  // Calls f(bytes) for each array with this name.
  template <class F>
  void for_each(std::string_view name, const F& f) const {
    for (const Array& array : arrays_) {
      if (array.name == name) f(std::as_bytes(std::span(array.bytes)));
    }
  }
  void apply() const {
    for (const auto& change : changes_) {
      if (change) change();
    }
  }

 private:
  struct Array {
    std::string_view name, bytes;
  };
  std::string_view next(std::string_view name) {
    std::uint64_t length = 0;
    require(left_.size() >= sizeof(length), "snapshot", "the array " + std::string(name), "the end of the bytes");
    std::memcpy(&length, left_.data(), sizeof(length));
    left_.remove_prefix(sizeof(length));
    require(left_.size() >= length, "snapshot", std::to_string(length) + " bytes of " + std::string(name), left_.size());
    const std::string_view bytes = left_.substr(0, length);
    left_.remove_prefix(length);
    return bytes;
  }

  std::string_view left_;
  std::vector<Array> arrays_;
  std::vector<std::function<void()>> changes_;
};

// Reads the size of a snapshot's batch from the lengths of its first arrays.
class SizeReader final : public ArrayVisitor {
 public:
  explicit SizeReader(std::string_view body) : left_(body) {}

  void bytes(std::string_view name, std::span<std::byte>, std::optional<DType>) override {
    std::uint64_t length = 0;
    if (left_.size() < sizeof(length)) return;
    std::memcpy(&length, left_.data(), sizeof(length));
    left_.remove_prefix(sizeof(length));
    left_.remove_prefix(std::min<std::size_t>(length, left_.size()));
    if (name == "active") num_drones = length;
    if (name == "episode") num_envs = length / sizeof(std::int64_t);
  }
  void blob(std::string_view, std::string&) override {}

  std::uint64_t num_drones = 0, num_envs = 0;

 private:
  std::string_view left_;
};

std::string size_text(std::uint64_t drones, std::uint64_t envs) {
  const auto counted = [](std::uint64_t count, const char* noun) {
    return std::to_string(count) + ' ' + noun + (count == 1 ? "" : "s");
  };
  return counted(drones, "drone") + " in " + counted(envs, "env");
}

void require_same_size(Simulation& sim, std::string_view body) {
  SizeReader reader(body);
  reader.fields(sim.state);
  require(reader.num_drones == sim.num_drones() && reader.num_envs == sim.num_envs(), "snapshot",
          "one of a batch with the same configuration and worlds (" + size_text(sim.num_drones(), sim.num_envs()) + ")",
          "one of " + size_text(reader.num_drones, reader.num_envs));
}

// Checks that a snapshot belongs to a batch with this configuration. Returns what follows the hashes of its parts: the arrays.
std::string_view require_same_config(Simulation& sim, std::uint64_t hash, std::string_view body) {
  const std::vector<ConfigPart>& parts = config_parts(sim);
  std::vector<std::uint64_t> theirs(parts.size());
  Reader reader(body);
  reader.array("config", theirs);
  reader.apply();
  if (hash != config_hash(sim)) {
    require_same_size(sim, reader.left());
    std::string differs = "configuration";
    for (std::size_t i = parts.size(); i-- > 0;) {
      if (parts[i].hash != theirs[i]) differs = parts[i].name;
    }
    refuse("snapshot", "one of a batch with the same configuration and worlds", "one that differs in " + differs);
  }
  return reader.left();
}

// Checks world indices before the restore, since they are used right after it.
void check_world_indices(const Simulation& sim, std::span<const std::byte> bytes) {
  for (std::size_t at = 0; at < bytes.size(); at += sizeof(std::int32_t)) {
    std::int32_t world = 0;
    std::memcpy(&world, bytes.data() + at, sizeof(world));
    require(world >= 0 && static_cast<std::size_t>(world) < sim.worlds.size(), "snapshot",
            "world indices below " + std::to_string(sim.worlds.size()), world);
  }
}

template <class T>
std::vector<T> values_of(std::span<const std::byte> bytes) {
  std::vector<T> values(bytes.size() / sizeof(T));
  std::memcpy(values.data(), bytes.data(), values.size() * sizeof(T));
  return values;
}

// Fetches the worlds of a snapshot's envs, and checks that their contents are the same as in the snapshot. Does not move the
// envs.
void fetch_worlds_of(Simulation& sim, const Reader& reader) {
  std::vector<std::uint64_t> contents;
  reader.for_each("world_content", [&](std::span<const std::byte> bytes) { contents = values_of<std::uint64_t>(bytes); });
  sim.pool->moves.clear();
  reader.for_each("world_index", [&](std::span<const std::byte> bytes) {
    const auto numbers = values_of<std::int32_t>(bytes);
    for (std::size_t env = 0; env < numbers.size(); ++env) {
      require(numbers[env] >= 0, "snapshot", "world numbers >= 0", numbers[env]);
      sim.pool->moves.push_back({EnvIndex(env), numbers[env], nullptr});
    }
  });
  fetch_worlds(sim);
  for (const Move& move : sim.pool->moves) {
    require(move.world->content_hash() == contents[move.env], "snapshot", "one of a batch whose pool makes the same worlds",
            "one with another world " + std::to_string(move.number));
  }
}

// The moves that bring all envs back to their current worlds.
std::vector<Move> moves_to_here(const Simulation& sim) {
  std::vector<Move> moves;
  for (std::size_t env = 0; env < sim.num_envs(); ++env) {
    moves.push_back({EnvIndex(env), sim.state.world_index[env], sim.worlds[sim.slot_of(EnvIndex(env))]});
  }
  return moves;
}

// Restores the arrays from a body that has been read and checked before.
void put(Simulation& sim, std::string_view body) {
  Reader reader(body);
  visit(sim, reader);
  reader.apply();
  if (sim.fleet) sim.fleet->restored(sim.state);
  if (sim.bodies) sim.bodies->restored();
  sim.lights.restored([&](const Light& light) { checks::drawable(sim.config, light); });
  for_each_sensor(sim, [](sensors::Sensor& sensor) { sensor.restored(); });
  sim.outputs.restored();
  if (sim.task_state) sim.task_state->task->restored();
}

// Checks the restored values: bytes with a correct checksum may still be an invalid state.
void check_values_of(Simulation& sim) {
  checks::poses(sim.state.position, sim.state.quat_wxyz, sim.num_drones());
  check_arrays(sim.state);
  check_arrays(sim.state.contact);
  check_arrays(sim.state.flight);
  check_arrays(sim.state.bodies);
  checks::poses(sim.state.bodies.position, sim.state.bodies.quat_wxyz, sim.state.bodies.active.size());
  for_each_sensor(sim, [](const sensors::Sensor& sensor) { sensor.check(); });
  if (!sim.task_state) return;
  check_arrays(sim.episodes);
  check_arrays(sim.outputs.now());
  for (const std::uint8_t end : sim.outputs.now().episode_end) {
    require(end < EnumNames<EpisodeEnd>::kNames.size(), "snapshot: episode_end", "a member of EpisodeEnd", +end);
  }
  if (sim.task_state->memory) sim.task_state->memory->check();
  sim.task_state->task->check();
}

}  // namespace

std::string make_snapshot(Simulation& sim) {
  for (std::size_t env = 0; sim.pool && env < sim.num_envs(); ++env) {
    sim.pool->contents[env] = sim.worlds[sim.slot_of(EnvIndex(env))]->content_hash();
  }
  std::string blob(sizeof(Header), '\0');
  Writer writer(blob);
  std::vector<std::uint64_t> hashes = hashes_of(config_parts(sim));
  writer.array("config", hashes);
  visit(sim, writer);
  const std::string_view body = std::string_view(blob).substr(sizeof(Header));
  Header header{kMagic, kFormat, config_hash(sim), body.size(), 0};
  header.checksum = checksum_of(header, body);
  std::memcpy(blob.data(), &header, sizeof(header));
  return blob;
}

void restore_snapshot(Simulation& sim, std::string_view blob) {
  Header header{};
  if (blob.size() < sizeof(header)) {
    throw std::invalid_argument("snapshot: " + std::to_string(blob.size()) + " bytes are too few for a snapshot");
  }
  std::memcpy(&header, blob.data(), sizeof(header));
  const std::string_view body = blob.substr(sizeof(header));
  require(header.magic == kMagic, "snapshot", "the bytes of Batch.snapshot()", "other bytes");
  require(header.format == kFormat, "snapshot", "format " + std::to_string(kFormat),
          std::to_string(header.format) + " (restore it with the version of flockstep that made it)");
  require(header.length == body.size(), "snapshot", std::to_string(header.length + sizeof(header)) + " bytes", blob.size());
  require(header.checksum == checksum_of(header, body), "snapshot", "bytes that match their checksum", "corrupt ones");
  const std::string_view arrays = require_same_config(sim, header.config, body);
  // Read and check everything before anything changes.
  Reader reader(arrays);
  visit_own(sim, reader);
  const auto check_worlds = [&](std::span<const std::byte> bytes) { check_world_indices(sim, bytes); };
  if (!sim.pool) {
    reader.for_each("world_index", check_worlds);
    reader.for_each("taken_world", check_worlds);
  }
  for_each_sensor(sim, [&](const sensors::Sensor& sensor) {
    reader.for_each(sensor.label(), [&](std::span<const std::byte> bytes) { sensor.check_bytes(bytes); });
  });
  std::size_t camera = 0;
  reader.for_each("camera_capture_mode", [&](std::span<const std::byte> bytes) {
    const auto mode = std::to_integer<int>(bytes[0]);
    require(mode <= static_cast<int>(CaptureMode::on_demand), "snapshot", "a capture mode below 3", mode);
    checks::capture_mode(sim, camera++, static_cast<CaptureMode>(mode));
  });
  std::optional<Reader> own;  // without the task's arrays; used with a pool
  if (sim.pool) own = reader;
  if (sim.task_state) sim.task_state->task->visit(reader);  // last, since its arrays may share names with those above
  reader.require_end();
  if (own) fetch_worlds_of(sim, *own);

  // Restore into the other output slot, like a step, so that the outputs of the last call stay intact. If a value is invalid or
  // the task rejects its state, undo everything.
  const std::string before = make_snapshot(sim);
  std::vector<Move> back;
  if (sim.pool) back = moves_to_here(sim);
  sim.outputs.turn();
  try {
    if (sim.pool) move_envs(sim);
    put(sim, arrays);
    check_values_of(sim);
  } catch (...) {
    const bool was_cut_short = std::exchange(sim.is_cut_short, true);  // stays set if undoing fails, for example without memory
    if (sim.pool) {
      sim.pool->moves = std::move(back);
      move_envs(sim);
    }
    put(sim, std::string_view(before).substr(sizeof(Header) + body.size() - arrays.size()));
    sim.is_cut_short = was_cut_short;
    sim.outputs.turn();
    throw;
  }
}

}  // namespace flockstep
