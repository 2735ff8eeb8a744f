// Service: answers the operations of all clients. Sessions bring calls from several threads; the service returns each call to its
// client when the reply is complete.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/batch.hpp"
#include "flockstep/batch_lock.hpp"
#include "flockstep/served_batch.hpp"
#include "flockstep/server.hpp"
#include "service/batch_arrays.hpp"
#include "service/call.hpp"
#include "service/executor.hpp"
#include "service/picture.hpp"
#include "service/workload.hpp"

namespace flockstep::server {

class Service {
 public:
  using Post = std::function<void(std::function<void()>)>;
  // post: runs a function later, on a thread of the sessions. run_aside, run_compression: run it on other threads, for work that
  // needs no batch: making a mesh, or compressing an image. Operations that may take long are marked in the workload.
  Service(Batch& batch, const ServerConfig& config, Post post, Post run_aside, Post run_compression, Workload& workload);
  ~Service();
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  // Gives a client its number and answers its Hello.
  void welcome(Call& call);
  // Answers a call, now or later; see Client::deliver().
  void answer(const std::shared_ptr<Call>& call);
  // Bytes that the arrays of a request may have.
  std::size_t max_array_bytes(const protocol::Request& request);
  // Ends the claims of a client and its part in the lockstep, after the operations that wait.
  void leave(const std::shared_ptr<Client>& client);

  // Ends the sharing of the batch; later calls do nothing. No thread may be in a call of this object.
  void unshare();
  // Drops the calls that wait for a step or for other calls. No thread may be in a call of this object.
  void drop_calls() {
    lockstep_.clear();
    executor_.clear();
  }

  // Makes a step of real time, when the batch is free. Does nothing while an earlier one is waiting.
  void tick();
  double rate_hz() const { return rate_hz_.load(std::memory_order_relaxed); }  // in real time; 0: none
  // Calls `call` whenever a client has set another rate.
  void on_new_rate(std::function<void()> call) { on_new_rate_ = std::move(call); }
  // Calls `call` with the reason when a step of real time has failed, which ends real time.
  void on_clock_failure(std::function<void(const std::string&)> call) { on_clock_failure_ = std::move(call); }

  // Calls `call` with a number when the first member of the lockstep begins to wait for the others.
  void on_lockstep_wait(std::function<void(std::uint64_t)> call) { on_lockstep_wait_ = std::move(call); }
  // Members for which the others still wait, since on_lockstep_wait() got this number, leave the lockstep.
  void end_lockstep_wait(std::uint64_t wait);

  // Counts what may have changed the batch.
  std::int64_t changes() const { return changes_.load(std::memory_order_relaxed); }
  std::int64_t answered() const { return answered_.load(std::memory_order_relaxed); }
  std::int64_t steps() const { return steps_.load(std::memory_order_relaxed); }

 private:
  // Holds the lock of the batch during an operation, and marks the operation if it may take long or has to wait for the lock.
  class Hold {
   public:
    Hold(Service& service, bool is_short);

   private:
    std::optional<BatchLock> lock_;
    std::optional<Workload::Mark> mark_;
  };

  // A copy of some properties of the batch, which needs no lock: what clients are told, and more.
  struct BatchInfo : protocol::Welcome {
    std::vector<CameraConfig> camera_configs;  // with their current capture modes
    Batch::Worlds worlds;
    std::size_t max_snapshot_bytes = 0;  // limit of a snapshot to restore; see also largest_snapshot_
    std::int64_t num_drones() const { return num_envs * drones_per_env; }
    std::int64_t num_bodies() const { return num_envs * bodies_per_env; }  // slots
  };

  // --- one function for each operation, by the way in which it is answered: see flockstep.proto. now() needs no batch; aside()
  // needs only worlds and may take long; read() reads arrays, of the batch or of a published copy; locked() holds the lock of the
  // batch; handle() has several parts.
#include "service/operations.inc"

  // --- ways to run a call: service.cpp
  template <class Operation>
  void handle(const std::shared_ptr<Call>& call, const Operation& operation);
  void run_locked(const std::shared_ptr<Call>& call, bool is_short, std::function<void(Call&)> operation);
  void complete(const std::shared_ptr<Call>& call);

  // --- camera images: cameras.cpp. Each returns the colours for a file, or nothing if the reply is complete.
  std::optional<Picture> take_frame(Call& call);                           // renders it if necessary; needs the lock
  bool take_published_frame(Call& call, std::optional<Picture>& picture);  // false if there is none that will do
  // Adds raw pixels to the reply, or returns the colours for a file.
  std::optional<Picture> copy_frame(Call& call, const ArraySource& arrays, const std::string& name, std::size_t drone);
  void compress_aside(const std::shared_ptr<Call>& call, std::optional<Picture> picture);

  // --- checks
  std::size_t require_drone(std::int64_t drone) const;                                  // active; needs the lock
  void require_may_change(const Call& call, std::int64_t drone) const;                  // by ownership
  void require_may_change(const Call& call, std::span<const std::uint8_t> mask) const;  // empty: all drones
  // mask: of envs or bodies. Its envs change for all their drones. Empty: all envs.
  void require_may_change_envs(const Call& call, std::span<const std::uint8_t> mask) const;
  void require_may_move(bool teleport) const;                   // to a pose, without rotors
  void require_bodies() const;                                  // that the batch has slots for them
  std::vector<std::uint8_t> body_mask(const Call& call) const;  // that of the request, of all slots; empty: all bodies
  std::vector<float> body_rows(const Call& call, const char* name,
                               std::int64_t columns) const;  // the request's, (E, B, columns)
  void change_bodies(Call& call, const std::function<void(std::span<const std::uint8_t> mask)>& change);
  // Returns the drones that a setting of a sensor changes: one, or all if the index is -1 or the setting is a common one.
  DroneMask require_drones(const Call& call, std::int64_t index, bool concerns_all);
  void require_sensor(const std::string& name) const;
  void require_env(std::int64_t env, const char* field) const;  // needs the lock
  std::shared_ptr<const World> world(std::uint32_t index) const;

  // --- motion; needs the lock
  void move(Call& call, std::int64_t drone, const std::optional<protocol::Vector3>& location,
            const std::optional<protocol::Quaternion>& rotation, bool teleport);
  // Returns a place for a new drone of an env: the given one if it is free, otherwise the start of the world or, if that is
  // taken, a place near it. env: the number of envs for a new one.
  std::array<float, 3> spawn_place(EnvIndex env, const std::optional<std::array<float, 3>>& location,
                                   const std::array<float, 4>& rotation) const;
  std::span<const std::uint8_t> only(std::size_t drone);  // a mask
  void fit_rows();                                        // resizes the arrays of rows after the batch has grown
  std::size_t command_size() const { return batch_.command_size(command_control_); }
  void clear_command(std::size_t drone);
  void drop_absent_commands();  // commands of drones that were removed, also by the program

  // --- time; needs the lock
  void begin_change();  // before a long call
  void advance();
  void write_time(Call& call) const;
  void step_if_all_wait();
  void count_program_steps();

  void refresh_info();                                            // these four need the lock
  void follow_program();                                          // whose calls may have changed it
  std::size_t max_snapshot_bytes(std::size_t array_bytes) const;  // array_bytes: of the batch, without observations
  void renumber(std::int64_t drones_per_env);                     // claims and commands, if that changes the indices of drones
  void follow_program_if_free();                                  // needs no lock
  std::shared_ptr<const BatchInfo> info() const;

  Batch& batch_;
  std::optional<ServedBatch> served_;  // until unshare()
  const Task* const task_;             // null without one
  const ServerConfig config_;
  const Post run_aside_, run_compression_;
  Workload& workload_;
  const double step_s_;
  std::function<void()> on_new_rate_;
  std::function<void(const std::string&)> on_clock_failure_;
  std::function<void(std::uint64_t)> on_lockstep_wait_;
  Executor executor_;
  Publisher publisher_;
  PictureMemory pictures_;
  FileMemory files_;
  RateMeter rate_;
  std::int64_t last_tick_ = 0;  // the first env's

  mutable std::mutex shape_mutex_;
  std::shared_ptr<const BatchInfo> info_;  // replaced, never changed

  mutable std::mutex owners_mutex_;
  std::map<std::int64_t, std::uint32_t> owners_;  // client by drone
  std::uint32_t last_client_ = 0;

  // Used with the lock.
  std::vector<float> positions_, rotations_;           // (N, 3), (N, 4): for calls that take rows of all drones
  std::vector<std::uint8_t> mask_;                     // (N,), see only()
  std::vector<float> ranges_, directions_;             // one scan's
  std::vector<float> commands_;                        // (N, command_size()), which steps fly; 0 without a command
  std::vector<std::uint8_t> has_command_;              // (N,)
  std::optional<Control> command_control_;             // all commands'
  std::map<Client*, std::shared_ptr<Call>> lockstep_;  // members, with the step for which they wait
  std::set<std::uint32_t> late_;                       // clients that have left the lockstep because they were late
  std::uint64_t lockstep_wait_ = 0;                    // number of the current or latest wait of members for each other

  std::atomic<double> rate_hz_;
  std::atomic<bool> is_tick_waiting_{false};
  std::atomic<bool> is_small_{true};          // copying all arrays without images, or one scan, takes less than a millisecond
  std::atomic<bool> steps_are_short_{false};  // the last StepEnvs took less than a millisecond
  std::atomic<bool> has_lines_{false};        // a client has made a move line or beams visible
  std::atomic<std::int64_t> changes_{0}, answered_{0}, steps_{0};
  std::atomic<std::size_t> largest_snapshot_{0};  // bytes of those that clients have got
};

}  // namespace flockstep::server
