#include "service/batch_arrays.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

#include "base/array_shape.hpp"
#include "flockstep/batch_lock.hpp"
#include "flockstep/served_batch.hpp"

namespace flockstep::server {
namespace {

constexpr std::int64_t kReadLatelyNs = 2'000'000'000;

std::int64_t now_ns() { return std::chrono::steady_clock::now().time_since_epoch() / std::chrono::nanoseconds(1); }

template <class Arrays>
void list_all(const Arrays& arrays, const ItemShape& items, const std::function<void(const ArrayView&)>& list) {
  for_each_view(arrays, items, [&](const ArrayView& view) {
    if (view.info.access != Access::internal) list(view);
  });
}

}  // namespace

void list_arrays(const Batch& batch, std::string_view sensor, const std::function<void(const ArrayView&)>& list) {
  if (!sensor.empty()) {
    for (const ArrayView& view : batch.sensor_arrays(sensor)) {
      if (view.info.access != Access::internal && view.size > 0) list(view);
    }
    return;
  }
  list_all(batch.state(), {}, list);
  list_all(batch.state().contact, {}, list);
  if (batch.bodies().per_env() > 0) {
    list_all(batch.state().bodies, {.bodies = {batch.config().num_envs, std::int64_t(batch.bodies().per_env())}}, list);
  }
  if (!batch.config().dynamics.is_kinematic()) {
    list_all(batch.state().flight, {.sizes = {std::int64_t(batch.num_rotors()), 1}, .dimensions = 1}, list);
  }
  list_all(batch.pose_readings(), {}, [&](const ArrayView& view) {
    if (view.size > 0) list(view);  // not a velocity that is not measured
  });
  if (batch.task() == nullptr) return;
  list_all(batch.episodes(), {}, list);
  list_all(batch.outputs(), {.sizes = {std::ssize(batch.spec().reward_terms), 1}, .dimensions = 1}, list);
}

std::vector<std::string> sensor_names(const BatchConfig& config) {
  std::vector<std::string> names;
  for_each_field(config, [&](const auto&, const auto& value) {
    if constexpr (requires { value.front().rate_hz; }) {
      for (const auto& sensor : value) names.push_back(sensor.name);
    }
  });
  return names;
}

protocol::DType dtype_of(const ArrayView& array) {
  using protocol::DType;
  switch (array.kind) {
    case 'b':
      return DType::kDtypeBool;
    case 'f':
      return array.value_size == 4 ? DType::kDtypeFloat32 : DType::kDtypeFloat64;
    case 'i':
      return array.value_size == 4 ? DType::kDtypeInt32 : DType::kDtypeInt64;
    default:
      return array.value_size == 1 ? DType::kDtypeUint8 : array.value_size == 2 ? DType::kDtypeUint16 : DType::kDtypeUint64;
  }
}

void add_array(protocol::FrameWriter& writer, const ArrayView& array) {
  const ArrayShape shape = shape_of(array);
  std::vector<std::size_t> sizes;
  for (const std::ptrdiff_t size : shape.span()) sizes.push_back(static_cast<std::size_t>(size));
  writer.add(array.name, dtype_of(array), {static_cast<const std::byte*>(array.data), array.size * array.value_size}, sizes);
}

void add_row(protocol::FrameWriter& writer, std::string_view name, const ArrayView& array, std::size_t row) {
  const ArrayShape shape = shape_of(array);
  std::vector<std::size_t> sizes;
  std::size_t bytes = array.value_size;
  for (std::size_t i = 1; i < shape.dimensions; ++i) {
    sizes.push_back(static_cast<std::size_t>(shape.sizes[i]));
    bytes *= sizes.back();
  }
  writer.add(name, dtype_of(array), {static_cast<const std::byte*>(array.data) + row * bytes, bytes}, sizes);
}

void add_rows(protocol::FrameWriter& writer, const ArrayView& array, std::span<const std::size_t> rows) {
  const ArrayShape shape = shape_of(array);
  std::vector<std::size_t> sizes{rows.size()};
  for (const std::ptrdiff_t size : shape.span().subspan(1)) sizes.push_back(static_cast<std::size_t>(size));
  writer.add_rows(array.name, dtype_of(array), static_cast<const std::byte*>(array.data), rows, sizes);
}

std::optional<ArrayView> ArraySource::find(std::string_view sensor, std::string_view name) const {
  std::optional<ArrayView> found;
  list(sensor, [&](const ArrayView& view) {
    if (view.name == name) found = view;
  });
  return found;
}

void ArraySource::describe(const Batch& batch) {
  num_envs = batch.config().num_envs;
  num_drones = batch.config().num_drones();
  drones_per_env = batch.config().drones_per_env;
  generation = ServedBatch::generation(batch);
}

LiveArrays::LiveArrays(const Batch& batch) : batch_(batch) { describe(batch); }

bool LiveArrays::list(std::string_view sensor, const std::function<void(const ArrayView&)>& list) const {
  list_arrays(batch_, sensor, list);
  return true;
}

const CameraConfig* LiveArrays::camera(std::string_view name) const { return &batch_.camera(name).config(); }

void CopiedArrays::keep_only(const std::vector<std::string>& sensors) {
  std::erase_if(sensors_, [&](const auto& entry) { return std::ranges::find(sensors, entry.first) == sensors.end(); });
}

void CopiedArrays::copy(const Batch& batch, std::string_view sensor) {
  auto found = sensors_.find(sensor);
  if (found == sensors_.end()) found = sensors_.emplace(sensor, Sensor()).first;
  std::vector<Copy>& copies = found->second.arrays;
  std::size_t count = 0;
  list_arrays(batch, sensor, [&](const ArrayView& view) {
    if (count == copies.size()) copies.emplace_back();
    Copy& copy = copies[count++];
    const auto* const bytes = static_cast<const std::byte*>(view.data);
    copy.values.assign(bytes, bytes + view.size * view.value_size);
    copy.view = view;
    copy.view.data = copy.values.data();
  });
  copies.resize(count);
  const auto& cameras = batch.config().cameras;
  const auto camera = std::ranges::find(cameras, sensor, &CameraConfig::name);
  found->second.camera.reset();
  if (camera != cameras.end()) found->second.camera = batch.camera(static_cast<std::size_t>(camera - cameras.begin())).config();
}

bool CopiedArrays::list(std::string_view sensor, const std::function<void(const ArrayView&)>& list) const {
  const auto found = sensors_.find(sensor);
  if (found == sensors_.end()) return false;
  for (const Copy& copy : found->second.arrays) list(copy.view);
  return true;
}

const CameraConfig* CopiedArrays::camera(std::string_view name) const {
  const auto found = sensors_.find(name);
  return found == sensors_.end() || !found->second.camera ? nullptr : &*found->second.camera;
}

std::shared_ptr<CopiedArrays> Publisher::make_copy() {
  std::unique_ptr<CopiedArrays> copy;
  {
    const std::scoped_lock lock(spare_->mutex);
    copy = std::move(spare_->copy);
  }
  if (!copy) copy = std::make_unique<CopiedArrays>();
  return {copy.release(), [spare = spare_](CopiedArrays* read) {
            std::unique_ptr<CopiedArrays> kept(read);
            const std::scoped_lock lock(spare->mutex);
            spare->copy.swap(kept);
          }};
}

void Publisher::publish(const Batch& batch, std::int64_t step) {
  const std::int64_t now = now_ns();
  std::vector<std::string> sensors;
  {
    const std::scoped_lock lock(mutex_);
    std::erase_if(last_read_ns_, [&](const auto& read) { return now - read.second > kReadLatelyNs; });
    for (const auto& [sensor, time] : last_read_ns_) sensors.push_back(sensor);
  }
  if (sensors.empty()) return;
  std::shared_ptr<CopiedArrays> copy = make_copy();
  copy->keep_only(sensors);
  for (const std::string& sensor : sensors) copy->copy(batch, sensor);
  copy->describe(batch);
  copy->step = step;
  const std::scoped_lock lock(mutex_);
  newest_.swap(copy);
  turn_ = BatchLock::turn(batch);
}

std::shared_ptr<const ArraySource> Publisher::read(const Batch& batch, std::string_view sensor) {
  const std::scoped_lock lock(mutex_);
  last_read_ns_.insert_or_assign(std::string(sensor), now_ns());
  if (!newest_ || BatchLock::turn(batch) != turn_) return nullptr;
  const bool has = newest_->list(sensor, [](const ArrayView&) {});
  return has ? newest_ : nullptr;
}

}  // namespace flockstep::server
