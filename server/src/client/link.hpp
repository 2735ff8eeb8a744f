// Link: what the copies of a Connection share. Call: a request and its reply.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "client/transport.hpp"
#include "protocol/frame.hpp"
#include "protocol/messages.hpp"

namespace flockstep::client::detail {

using AddArrays = std::function<void(protocol::FrameWriter&)>;

// A reply with its arrays, which point into the others.
struct ReceivedReply {
  protocol::Reply header;
  Message bytes;
  std::vector<protocol::ReceivedArray> arrays;
};

// State of a call, for which the mutex of the link is needed.
struct CallState {
  std::unique_ptr<ReceivedReply> reply;  // the newest that was not taken
  bool was_taken = false;                // and no other reply will come
  std::optional<Error> error;            // that ended the call
};

// All members are thread-safe. The thread that waits for a reply reads the socket, and hands the replies of others to them. If
// several wait, one of them reads.
class Link : public std::enable_shared_from_this<Link> {
 public:
  explicit Link(const Options& options);
  ~Link();
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;

  // Sends Hello. To be called once, first.
  void introduce();
  // Sends a request with the arrays that `add` adds, and returns its call.
  std::shared_ptr<Call> send(protocol::Request request, const AddArrays& add = {});
  // Like send(), for a stream of replies.
  std::shared_ptr<Call> subscribe(protocol::Subscribe what);
  // Ends a stream whose values nobody will take.
  void unsubscribe(std::uint64_t stream);
  // Waits until take() returns or throws at once. Throws the error that ended the call or the connection. Returns false if
  // the time has passed.
  bool wait_for(const Call& call, std::chrono::nanoseconds timeout);
  // Waits up to Options::timeout, and throws if the time has passed.
  void wait(const Call& call);
  // Takes the reply of a call that has one. Throws if it was taken before.
  std::unique_ptr<ReceivedReply> take(const Call& call);
  // Takes the memory of a reply that has been read, for a later one: new memory costs more than the copy into it.
  void reuse(Message memory) noexcept;

  const ServerInfo& server() const { return server_; }
  bool is_open() const;

 private:
  // A request whose reply is to come, or a stream.
  struct Expected {
    std::weak_ptr<CallState> call;  // expired if nobody will take the reply
    std::uint64_t stream = 0;       // that the request ends; 0: none
    bool is_stream = false;
  };
  using Lock = std::unique_lock<std::mutex>;

  std::shared_ptr<Call> start(protocol::Request request, const AddArrays& add, Expected expected);
  // Lets the transport work until is_done() or the deadline; returns is_done(). A transport that has failed ends the wait.
  template <class IsDone>
  bool run_until(Lock& lock, IsDone is_done, Clock::time_point deadline);
  void advance(bool may_read);
  void receive(Message& message);
  void take_reply(std::unique_ptr<ReceivedReply> reply);
  void fail(ErrorCode code, const std::string& text);
  // Returns the error that ended the connection, or a timeout.
  Error failure() const;

  const Options options_;
  ServerInfo server_;
  Waker waker_;
  mutable std::mutex mutex_;  // guards all below
  std::condition_variable changed_;
  std::unique_ptr<Transport> transport_;
  protocol::FrameWriter writer_;
  Message spare_;         // empty, with memory
  bool is_open_ = false;  // the handshakes are done
  bool is_sending_ = false;
  bool is_polling_ = false;  // a thread waits for the socket, without the mutex
  std::optional<Error> failure_;
  std::uint64_t last_id_ = 0;
  std::unordered_map<std::uint64_t, Expected> expected_;  // by id of the request
};

class Call {
 public:
  Call(std::shared_ptr<Link> link, std::uint64_t id, bool is_stream);
  ~Call();
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;

  Link& link() const { return *link_; }

 private:
  friend class Link;

  const std::shared_ptr<Link> link_;
  const std::shared_ptr<CallState> state_ = std::make_shared<CallState>();
  const std::uint64_t id_;
  const bool is_stream_;
};

}  // namespace flockstep::client::detail
