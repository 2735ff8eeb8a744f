// ArrayVisitor: visits every array of a state. Snapshots are written and restored through it.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "flockstep/buffer.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

class ArrayVisitor {
 public:
  virtual ~ArrayVisitor() = default;

  // Visits an array of fixed size. Names are unique within one owner.
  template <class T, class Allocator>
  void array(std::string_view name, std::vector<T, Allocator>& values) {
    static_assert(std::is_trivially_copyable_v<T>);
    if constexpr (is_dtype<T>) {
      bytes(name, std::as_writable_bytes(std::span(values)), kDType<T>);
    } else {
      bytes(name, std::as_writable_bytes(std::span(values)), std::nullopt);
    }
  }
  // Visits an array as bytes. type: type of its values; nullopt if it is not a DType, for example a struct.
  virtual void bytes(std::string_view name, std::span<std::byte> bytes, std::optional<DType> type) = 0;

  // Visits a byte string of variable size. Restoring a snapshot sets it before Task::restored() is called.
  virtual void blob(std::string_view name, std::string& bytes) = 0;

  // Visits all arrays of a struct that lists its fields.
  template <HasFields T>
  void fields(T& state) {
    for_each_field(state, [this](const auto& field, auto& value) {
      using Value = std::remove_cvref_t<decltype(value)>;
      if constexpr (HasFields<Value>) {
        fields(value);
      } else if constexpr (std::is_same_v<Value, std::vector<Buffer>>) {
        for (Buffer& buffer : value) bytes(field.name, buffer.bytes(), buffer.type());
      } else {
        array(field.name, value);
      }
    });
  }
};

}  // namespace flockstep
