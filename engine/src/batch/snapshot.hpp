// Snapshots: a header, a hash of the configuration, then arrays; written and read in the order of arrays.hpp.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "base/require.hpp"
#include "flockstep/config.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// FNV-1a, 64 bit (Fowler, Noll, Vo).
inline std::uint64_t hash_bytes(std::string_view bytes) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const char byte : bytes) hash = (hash ^ static_cast<unsigned char>(byte)) * 0x100000001b3ULL;
  return hash;
}

// Of everything that decides what a step does; not of the thread count or block size, which decide nothing.
std::uint64_t config_hash(const BatchConfig& config, const std::vector<std::shared_ptr<const World>>& worlds,
                          const DroneModel& drone);

class SnapshotWriter {
 public:
  template <class T>
  void value(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    const auto size = bytes_.size();
    bytes_.resize(size + sizeof(T));
    std::memcpy(bytes_.data() + size, &value, sizeof(T));
  }
  template <class T>
  void array(const std::vector<T>& values) {
    static_assert(std::is_trivially_copyable_v<T>);
    value(static_cast<std::uint64_t>(values.size()));
    bytes_.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  }
  std::string take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

class SnapshotReader {
 public:
  explicit SnapshotReader(std::string_view bytes) : bytes_(bytes) {}

  template <class T>
  T value() {
    T value;
    std::memcpy(&value, next(sizeof(T)), sizeof(T));
    return value;
  }
  // Checks that the array has as many values as `like`.
  template <class T>
  std::vector<T> array(const std::vector<T>& like) {
    const auto size = value<std::uint64_t>();
    require(size == like.size(), "snapshot", "an array of " + std::to_string(like.size()) + " values", size);
    std::vector<T> values(like.size());
    if (!values.empty()) std::memcpy(values.data(), next(values.size() * sizeof(T)), values.size() * sizeof(T));
    return values;
  }
  void require_end() const { require(bytes_.size() == at_, "snapshot", std::to_string(at_) + " bytes", bytes_.size()); }

 private:
  const char* next(std::size_t count) {
    require(bytes_.size() - at_ >= count, "snapshot", "at least " + std::to_string(at_ + count) + " bytes", bytes_.size());
    at_ += count;
    return bytes_.data() + at_ - count;
  }
  std::string_view bytes_;
  std::size_t at_ = 0;
};

}  // namespace flockstep
