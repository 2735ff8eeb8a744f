#include "service/call.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <new>
#include <stdexcept>
#include <utility>

#include "base/require.hpp"

namespace flockstep::server {
namespace {

template <class Sizes>
std::string text_of(const Sizes& sizes) {
  std::string text;
  for (const auto size : sizes) {
    text += (text.empty() ? "(" : ", ") + (static_cast<std::int64_t>(size) < 0 ? "any" : std::to_string(size));
  }
  return (text.empty() ? "(" : text) + ")";
}

}  // namespace

std::optional<protocol::ReceivedArray> Call::find(std::string_view name, protocol::DType type,
                                                  const std::vector<std::int64_t>& shape) const {
  for (const protocol::ReceivedArray& received : protocol::read_arrays(bytes, request.arrays)) {
    const protocol::Array& array = *received.array;
    if (array.name != name) continue;
    require(array.dtype == type, name, "values of type " + std::to_string(static_cast<int>(type)),
            "type " + std::to_string(static_cast<int>(array.dtype)));
    const bool fits = std::ranges::equal(array.shape, shape, [](std::uint64_t got, std::int64_t expected) {
      return expected < 0 || got == static_cast<std::uint64_t>(expected);
    });
    require(fits, name, "shape " + text_of(shape), "shape " + text_of(array.shape));
    return received;
  }
  return std::nullopt;
}

std::optional<std::string> Call::take_bytes(std::string_view name) {
  const auto found = find(name, protocol::DType::kDtypeUint8, {-1});
  if (!found) return std::nullopt;
  const std::size_t size = found->bytes.size();
  bytes.erase(0, static_cast<std::size_t>(reinterpret_cast<const char*>(found->bytes.data()) - bytes.data()));
  bytes.resize(size);
  return std::exchange(bytes, {});
}

std::optional<std::vector<std::uint8_t>> Call::flags(std::string_view name, const std::vector<std::int64_t>& shape) const {
  const auto found = find(name, protocol::DType::kDtypeBool, shape);
  if (!found) return std::nullopt;
  std::vector<std::uint8_t> flags = found->values<std::uint8_t>();
  for (const std::uint8_t flag : flags) require(flag <= 1, name, "flags, 0 or 1", static_cast<int>(flag));
  return flags;
}

void Call::require_listed() const {
  if (request.arrays.empty()) return;
  const std::vector<protocol::RequestArray> listed = protocol::arrays_of(request);
  std::string known;
  for (const protocol::RequestArray& array : listed) known += (known.empty() ? "" : ", ") + std::string(array.name);
  for (const protocol::Array& array : request.arrays) {
    require(std::ranges::find(listed, array.name, &protocol::RequestArray::name) != listed.end(), "arrays",
            known.empty() ? "no array for this operation" : known, '"' + array.name + '"');
  }
}

void Call::finish() {
  reply.id = request.id;
  writer.finish(reply);
  const std::size_t size = writer.header().size();
  if (size <= sizeof(std::uint32_t) + protocol::kMaxHeaderBytes<protocol::Reply>) return;
  fail(protocol::Code::kResourceExhausted, "the reply is too long: it has " + std::to_string(size) + " bytes without arrays");
  reply.id = request.id;
  writer.finish(reply);
}

void Call::fail(protocol::Code code, const std::string& text) {
  writer.clear();
  reply = {};
  result<protocol::Error>() = {.code = code, .text = text};
}

void Call::fail_by_exception() {
  using protocol::Code;
  try {
    throw;
  } catch (const Refusal& error) {
    fail(error.code(), error.what());
  } catch (const std::invalid_argument& error) {
    fail(Code::kInvalidArgument, error.what());
  } catch (const std::bad_alloc&) {
    fail(Code::kResourceExhausted, "the server has not enough memory for this");
  } catch (const std::logic_error& error) {
    fail(Code::kFailedPrecondition, error.what());
  } catch (const std::runtime_error& error) {
    fail(Code::kFailedPrecondition, error.what());
  } catch (const std::exception& error) {
    const std::string text = error.what();  // Python's has a traceback, whose paths are none of the client's business
    fail(Code::kInternal, text.substr(0, text.find('\n')));
  }
}

}  // namespace flockstep::server
