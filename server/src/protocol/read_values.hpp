// Reads the values of fields with a check of their types, for messages.cpp.
#pragma once

#include <cmath>
#include <cstdint>
#include <protozero/pbf_reader.hpp>
#include <protozero/pbf_writer.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace flockstep::protocol {

[[noreturn]] inline void refuse_value(const char* field, const std::string& expected, const std::string& got) {
  throw std::invalid_argument(std::string(field) + ": expected " + expected + ", got " + got);
}

bool is_utf8(std::string_view text);

// protozero checks types by assertions only.
inline void require_type(const protozero::pbf_reader& reader, protozero::pbf_wire_type type, const char* field) {
  if (reader.wire_type() != type) {
    refuse_value(field, "wire type " + std::to_string(static_cast<int>(type)),
                 "wire type " + std::to_string(static_cast<int>(reader.wire_type())));
  }
}

inline void skip_all(protozero::pbf_reader& reader) {
  while (reader.next()) reader.skip();
}

#define FLOCKSTEP_READ(kind, type, wire)                                      \
  inline type read_##kind(protozero::pbf_reader& reader, const char* field) { \
    require_type(reader, protozero::pbf_wire_type::wire, field);              \
    return reader.get_##kind();                                               \
  }
FLOCKSTEP_READ(bool, bool, varint)
FLOCKSTEP_READ(int32, std::int32_t, varint)
FLOCKSTEP_READ(int64, std::int64_t, varint)
FLOCKSTEP_READ(uint32, std::uint32_t, varint)
FLOCKSTEP_READ(uint64, std::uint64_t, varint)
FLOCKSTEP_READ(float, float, fixed32)
FLOCKSTEP_READ(double, double, fixed64)
FLOCKSTEP_READ(string, std::string, length_delimited)
#undef FLOCKSTEP_READ

// Repeated numbers may come packed or one by one.
#define FLOCKSTEP_READ_PACKED(kind, type)                                                                      \
  inline std::vector<type> packed_##kind(protozero::pbf_reader& reader, const char* field) {                   \
    if (reader.wire_type() != protozero::pbf_wire_type::length_delimited) return {read_##kind(reader, field)}; \
    const auto values = reader.get_packed_##kind();                                                            \
    return {values.begin(), values.end()};                                                                     \
  }
FLOCKSTEP_READ_PACKED(int64, std::int64_t)
FLOCKSTEP_READ_PACKED(uint64, std::uint64_t)
FLOCKSTEP_READ_PACKED(double, double)
#undef FLOCKSTEP_READ_PACKED

inline std::int32_t read_enum(protozero::pbf_reader& reader, std::int32_t last, const char* field) {
  require_type(reader, protozero::pbf_wire_type::varint, field);
  const std::int32_t value = reader.get_enum();
  if (value < 0 || value > last) refuse_value(field, "a number in [0, " + std::to_string(last) + "]", std::to_string(value));
  return value;
}

template <class Real>
Real finite(Real value, const char* field) {
  if (!std::isfinite(value)) refuse_value(field, "a finite number", std::to_string(value));
  return value;
}

// A text that is at most as long as the message. Protocol Buffers require UTF-8.
inline std::string long_text(std::string text, const char* field) {
  if (!is_utf8(text)) refuse_value(field, "UTF-8", "other bytes");
  return text;
}

// A name or a token. Messages quote names.
inline std::string short_text(std::string text, const char* field) {
  constexpr std::size_t kMostBytes = 1024;
  if (text.size() > kMostBytes) {
    refuse_value(field, "at most " + std::to_string(kMostBytes) + " bytes", std::to_string(text.size()));
  }
  return long_text(std::move(text), field);
}

// Not by a writer in the writer: protozero leaves out messages that turn out to be empty.
template <class Message>
void write_message(protozero::pbf_writer& writer, protozero::pbf_tag_type tag, const Message& message) {
  std::string bytes;
  protozero::pbf_writer part(bytes);
  message.write(part);
  writer.add_message(tag, bytes);
}

}  // namespace flockstep::protocol
