// Call: a request of a client with its reply. Client: the session that the reply returns to.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/require.hpp"
#include "protocol/frame.hpp"
#include "protocol/messages.hpp"

namespace flockstep::server {

// An operation is refused.
class Refusal : public std::runtime_error {
 public:
  Refusal(protocol::Code code, const std::string& text) : std::runtime_error(text), code_(code) {}
  protocol::Code code() const { return code_; }

 private:
  protocol::Code code_;
};

struct Call;

class Client {
 public:
  Client() = default;
  virtual ~Client() = default;
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  // Takes a call whose reply is complete. Any thread may call this.
  virtual void deliver(const std::shared_ptr<Call>& call) = 0;

  std::uint32_t number = 0;          // from 1; set when the client says Hello
  std::atomic<bool> is_gone{false};  // nobody receives its replies any more
};

struct Call {
  std::shared_ptr<Client> client;
  protocol::Request request;
  std::string bytes;  // the whole message of the request
  protocol::Reply reply{};
  protocol::FrameWriter writer{};
  bool is_of_stream = false;  // a value of a stream, whose request has the same id

  // Returns an array of the request; nothing if it has none of this name. Throws std::invalid_argument if its type or shape is
  // another; -1 in the shape allows any size.
  template <class T>
  std::optional<std::vector<T>> array(std::string_view name, const std::vector<std::int64_t>& shape) const {
    const auto found = find(name, protocol::dtype_of<T>(), shape);
    return found ? std::optional(found->template values<T>()) : std::nullopt;
  }
  // Like array(), for one that must be there.
  template <class T>
  std::vector<T> given(const char* name, const std::vector<std::int64_t>& shape) const {
    std::optional<std::vector<T>> found = array<T>(name, shape);
    require(found.has_value(), name, "an array of this name", "none");
    return std::move(*found);
  }
  // Like array(), for any number of bytes. Takes them out of the message without another copy in memory: arrays can be read no
  // more.
  std::optional<std::string> take_bytes(std::string_view name);
  // Like array(), for flags: as bytes, 0 or 1.
  std::optional<std::vector<std::uint8_t>> flags(std::string_view name, const std::vector<std::int64_t>& shape) const;
  // Throws std::invalid_argument if the request has arrays that flockstep.proto does not list for its operation.
  void require_listed() const;

  template <class Result>
  Result& result() {
    return reply.result.template emplace<Result>();
  }
  // Replaces the reply by an error.
  void fail(protocol::Code code, const std::string& text);
  void fail_by_exception();  // the one that is being handled
  // Writes the reply, with the id of the request. A reply that is too long becomes an error.
  void finish();

 private:
  std::optional<protocol::ReceivedArray> find(std::string_view name, protocol::DType type,
                                              const std::vector<std::int64_t>& shape) const;
};

// Runs an operation, and makes a reply of its exception. An operation of a client that is gone does not run.
template <class Operation>
void guard(Call& call, const Operation& operation) {
  try {
    if (call.client->is_gone) throw Refusal(protocol::Code::kFailedPrecondition, "the client is gone");
    operation();
    if (std::holds_alternative<std::monostate>(call.reply.result)) call.result<protocol::Done>();
  } catch (const std::exception&) {
    call.fail_by_exception();
  }
}

}  // namespace flockstep::server
