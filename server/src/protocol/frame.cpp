#include "protocol/frame.hpp"

#include <array>
#include <bit>
#include <utility>

#include "protocol/read_values.hpp"

namespace flockstep::protocol {

static_assert(std::endian::native == std::endian::little, "arrays are sent as they are in memory");

namespace {
constexpr std::size_t kMaxArrayBytes = std::size_t{1} << 40;
}  // namespace

bool is_utf8(std::string_view text) {
  for (std::size_t at = 0; at < text.size();) {
    const auto byte = [&](std::size_t i) { return at + i < text.size() ? static_cast<unsigned char>(text[at + i]) : 0U; };
    const unsigned first = byte(0);
    const std::size_t more = first < 0x80U   ? 0
                             : first < 0xC2U ? 4
                             : first < 0xE0U ? 1
                             : first < 0xF0U ? 2
                             : first < 0xF5U ? 3
                                             : 4;
    if (more == 4) return false;
    for (std::size_t i = 1; i <= more; ++i) {
      if ((byte(i) & 0xC0U) != 0x80U) return false;
    }
    // Overlong forms, surrogates, and numbers above 0x10FFFF.
    if ((first == 0xE0U && byte(1) < 0xA0U) || (first == 0xEDU && byte(1) > 0x9FU)) return false;
    if ((first == 0xF0U && byte(1) < 0x90U) || (first == 0xF4U && byte(1) > 0x8FU)) return false;
    at += 1 + more;
  }
  return true;
}

std::size_t size_of(DType type) {
  constexpr std::array<std::size_t, 9> kSizes{0, 1, 1, 2, 4, 8, 8, 4, 8};  // in the order of DType
  static_assert(static_cast<std::size_t>(DType::kDtypeFloat64) + 1 == kSizes.size());
  const auto number = static_cast<std::size_t>(type);
  return number < kSizes.size() ? kSizes[number] : 0;
}

std::size_t bytes_of(const Array& array) {
  std::size_t bytes = size_of(array.dtype);
  if (bytes == 0) refuse_value("arrays.dtype", "a type", std::to_string(static_cast<int>(array.dtype)));
  if (array.shape.size() > 8) refuse_value("arrays.shape", "at most 8 dimensions", std::to_string(array.shape.size()));
  for (const std::uint64_t size : array.shape) {
    if (size != 0 && bytes > kMaxArrayBytes / size) refuse_value("arrays.shape", "at most 2^40 bytes", "more");
    bytes *= static_cast<std::size_t>(size);
  }
  return bytes;
}

std::size_t bytes_of(std::span<const Array> arrays) {
  std::size_t bytes = 0;
  for (const Array& array : arrays) bytes += bytes_of(array);  // a header has room for fewer than 2^23 of them
  return bytes;
}

void FrameWriter::add(std::string_view name, DType type, std::span<const std::byte> values, std::span<const std::size_t> shape) {
  arrays_.push_back({.name = std::string(name), .dtype = type, .shape = {shape.begin(), shape.end()}});
  values_.append(reinterpret_cast<const char*>(values.data()), values.size());
}

void FrameWriter::add_bytes(std::string_view name, std::string bytes) {
  arrays_.push_back({.name = std::string(name), .dtype = DType::kDtypeUint8, .shape = {bytes.size()}});
  if (values_.empty()) {
    values_ = std::move(bytes);
  } else {
    values_ += bytes;
  }
}

void FrameWriter::add_rows(std::string_view name, DType type, const std::byte* values, std::span<const std::size_t> rows,
                           std::span<const std::size_t> shape) {
  add(name, type, std::span<const std::byte>(), shape);
  std::size_t bytes = size_of(type);
  for (const std::size_t size : shape.subspan(1)) bytes *= size;
  for (const std::size_t row : rows) values_.append(reinterpret_cast<const char*>(values + row * bytes), bytes);
}

void FrameWriter::clear() {
  arrays_.clear();
  header_.clear();
  values_.clear();
}

std::size_t header_size(std::string_view bytes, std::size_t limit) {
  std::uint32_t size = 0;
  if (bytes.size() < sizeof(size)) return 0;
  std::memcpy(&size, bytes.data(), sizeof(size));
  if (size > limit) {
    refuse_value("message", "a header of at most " + std::to_string(limit) + " bytes", std::to_string(size));
  }
  return size;
}

std::vector<ReceivedArray> read_arrays(std::string_view bytes, std::span<const Array> arrays) {
  const std::size_t header = sizeof(std::uint32_t) + header_size<Reply>(bytes);  // the larger limit
  const std::size_t values = bytes_of(arrays);
  if (bytes.size() < header || bytes.size() - header != values) {
    refuse_value("message", std::to_string(header + values) + " bytes", std::to_string(bytes.size()));
  }
  std::vector<ReceivedArray> result;
  const auto* at = reinterpret_cast<const std::byte*>(bytes.data()) + header;
  for (const Array& array : arrays) {
    const std::size_t size = bytes_of(array);
    result.push_back({&array, {at, size}});
    at += size;
  }
  return result;
}

}  // namespace flockstep::protocol
