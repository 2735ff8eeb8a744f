// The arrays of a batch by name, as clients read them: from the batch itself, or from a copy of one moment.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/arrays.hpp"
#include "flockstep/batch.hpp"
#include "protocol/frame.hpp"

namespace flockstep::server {

// Lists the arrays of a sensor, or those of the batch if its name is empty. The caller holds the lock of the batch. Throws
// std::invalid_argument if there is no such sensor.
void list_arrays(const Batch& batch, std::string_view sensor, const std::function<void(const ArrayView&)>& list);

// Returns the names of all sensors.
std::vector<std::string> sensor_names(const BatchConfig& config);

protocol::DType dtype_of(const ArrayView& array);
// Adds an array to a message, or one row of it under another name. A row of an array of bodies is an env with all its slots.
void add_array(protocol::FrameWriter& writer, const ArrayView& array);
void add_row(protocol::FrameWriter& writer, std::string_view name, const ArrayView& array, std::size_t row);
// Adds an array of some of its rows.
void add_rows(protocol::FrameWriter& writer, const ArrayView& array, std::span<const std::size_t> rows);

// Arrays of one moment.
class ArraySource {
 public:
  virtual ~ArraySource() = default;
  // Calls list for each array of a sensor, or of the batch if its name is empty. Returns false if they are not known.
  virtual bool list(std::string_view sensor, const std::function<void(const ArrayView&)>& list) const = 0;
  // Returns the configuration of a camera when its arrays were made, with the capture mode; null if they are not known.
  virtual const CameraConfig* camera(std::string_view name) const = 0;

  // Returns an array; nothing if there is none of this name.
  std::optional<ArrayView> find(std::string_view sensor, std::string_view name) const;
  // Sets the fields below, except the step.
  void describe(const Batch& batch);

  std::int64_t num_envs = 0;
  std::int64_t num_drones = 0;
  std::int64_t drones_per_env = 1;
  std::int64_t generation = 0;
  std::int64_t step = 0;
};

// The arrays of a batch whose lock the caller holds.
class LiveArrays final : public ArraySource {
 public:
  explicit LiveArrays(const Batch& batch);
  bool list(std::string_view sensor, const std::function<void(const ArrayView&)>& list) const override;
  const CameraConfig* camera(std::string_view name) const override;

 private:
  const Batch& batch_;
};

// A copy of arrays. It stays valid while the batch changes.
class CopiedArrays final : public ArraySource {
 public:
  void keep_only(const std::vector<std::string>& sensors);
  void copy(const Batch& batch, std::string_view sensor);
  bool list(std::string_view sensor, const std::function<void(const ArrayView&)>& list) const override;
  const CameraConfig* camera(std::string_view name) const override;

 private:
  struct Copy {
    ArrayView view;
    std::vector<std::byte> values;
  };
  struct Sensor {
    std::vector<Copy> arrays;
    std::optional<CameraConfig> camera;  // a camera's
  };
  std::map<std::string, Sensor, std::less<>> sensors_;
};

// Publishes copies of the arrays that clients have read lately, so that they can read while a step runs. A copy is made before
// each long call on the batch, and is valid until that call ends.
class Publisher {
 public:
  // Makes a copy. The caller holds the lock of the batch.
  void publish(const Batch& batch, std::int64_t step);
  // Returns the copy while the call before which it was made is still running; otherwise null. Notes that the arrays of this
  // sensor are read, so that the next copy has them.
  std::shared_ptr<const ArraySource> read(const Batch& batch, std::string_view sensor);

 private:
  // Memory of a copy that nobody reads any more, for the next one.
  struct Spare {
    std::mutex mutex;
    std::unique_ptr<CopiedArrays> copy;
  };

  std::shared_ptr<CopiedArrays> make_copy();

  std::mutex mutex_;
  std::map<std::string, std::int64_t, std::less<>> last_read_ns_;  // by sensor
  std::shared_ptr<Spare> spare_ = std::make_shared<Spare>();
  std::shared_ptr<CopiedArrays> newest_;
  std::uint64_t turn_ = 0;  // turn of the lock in which newest_ was made
};

}  // namespace flockstep::server
