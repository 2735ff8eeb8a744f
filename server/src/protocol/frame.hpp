// Frame: a message of the protocol with its arrays, as bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "protocol/messages.hpp"

namespace flockstep::protocol {

inline constexpr std::uint32_t kVersion = 2;
// Bytes that a Request or Reply may have without the values of its arrays. A Reply may list all drones.
template <class Message>
inline constexpr std::size_t kMaxHeaderBytes = std::size_t{1} << (std::is_same_v<Message, Reply> ? 26U : 16U);

// Arrays of a Request. No operation has more than five.
inline constexpr std::size_t kMaxRequestArrays = 8;
// Bytes of a message with its arrays.
inline constexpr std::size_t kMaxMessageBytes = std::size_t{1} << 41U;

// The DType of a C++ type.
template <class T>
constexpr DType dtype_of() {
  if constexpr (std::is_same_v<T, bool>) return DType::kDtypeBool;
  if constexpr (std::is_same_v<T, std::uint8_t>) return DType::kDtypeUint8;
  if constexpr (std::is_same_v<T, std::uint16_t>) return DType::kDtypeUint16;
  if constexpr (std::is_same_v<T, std::int32_t>) return DType::kDtypeInt32;
  if constexpr (std::is_same_v<T, std::int64_t>) return DType::kDtypeInt64;
  if constexpr (std::is_same_v<T, std::uint64_t>) return DType::kDtypeUint64;
  if constexpr (std::is_same_v<T, float>) return DType::kDtypeFloat32;
  if constexpr (std::is_same_v<T, double>) return DType::kDtypeFloat64;
}
// Bytes of a value; 0 for kDtypeUnspecified.
std::size_t size_of(DType type);
// Bytes of an array. Throws std::invalid_argument if it has no type, more than 8 dimensions, or more than 2^40 bytes.
std::size_t bytes_of(const Array& array);

// Writes a message: add the arrays, then call finish(). The message is header() followed by values(), which are sent as two
// buffers, so that large arrays are copied once. clear() allows another message, which reuses the memory.
class FrameWriter {
 public:
  // Adds an array. Its values are copied now.
  template <class T>
  void add(std::string_view name, std::span<const T> values, std::initializer_list<std::size_t> shape) {
    add(name, dtype_of<T>(), std::as_bytes(values), std::span(shape.begin(), shape.size()));
  }
  void add(std::string_view name, DType type, std::span<const std::byte> values, std::span<const std::size_t> shape);
  // Adds an array of bytes, without a copy if it is the first one.
  void add_bytes(std::string_view name, std::string bytes);
  // Adds an array of some rows of another one, whose values begin at `values`. The shape is that of the new array.
  void add_rows(std::string_view name, DType type, const std::byte* values, std::span<const std::size_t> rows,
                std::span<const std::size_t> shape);
  // Allocates memory for the values of all arrays, so that adding a large one does not copy those before it.
  void reserve(std::size_t bytes) { values_.reserve(bytes); }

  // Writes the header with the descriptions of the arrays.
  template <class Message>
  void finish(Message& message) {
    message.arrays = std::move(arrays_);
    header_.assign(sizeof(std::uint32_t), '\0');
    protozero::pbf_writer writer(header_);
    message.write(writer);
    const auto size = static_cast<std::uint32_t>(header_.size() - sizeof(std::uint32_t));
    std::memcpy(header_.data(), &size, sizeof(size));
  }
  void clear();

  const std::string& header() const { return header_; }
  const std::string& values() const { return values_; }
  std::size_t size() const { return header_.size() + values_.size(); }

 private:
  std::vector<Array> arrays_;
  std::string header_;
  std::string values_;
};

// The values of a received array. They are not aligned.
struct ReceivedArray {
  const Array* array;
  std::span<const std::byte> bytes;

  template <class T>
  std::vector<T> values() const {
    std::vector<T> result(bytes.size() / sizeof(T));
    if (!result.empty()) std::memcpy(result.data(), bytes.data(), result.size() * sizeof(T));
    return result;
  }
};

// Size of the header at the beginning of a message, or 0 while fewer than 4 bytes have come. Throws std::invalid_argument if it
// is above the limit.
std::size_t header_size(std::string_view bytes, std::size_t limit);
template <class Message>
std::size_t header_size(std::string_view bytes) {
  return header_size(bytes, kMaxHeaderBytes<Message>);
}

// Reads the header of a message that has all of it.
template <class Message>
void read_header(std::string_view bytes, Message& message) {
  message.read(protozero::pbf_reader(bytes.data() + sizeof(std::uint32_t), header_size<Message>(bytes)));
}

// Bytes of all arrays of a message.
std::size_t bytes_of(std::span<const Array> arrays);

// Returns the arrays of a complete message, whose header was read before. Throws std::invalid_argument if their sizes do not add
// up to that of the message. The values point into `bytes`.
std::vector<ReceivedArray> read_arrays(std::string_view bytes, std::span<const Array> arrays);

}  // namespace flockstep::protocol
