#include "client/link.hpp"

#include <string_view>
#include <utility>
#include <variant>

#include "client/convert.hpp"

namespace flockstep::client::detail {
namespace {

Clock::time_point after(std::chrono::nanoseconds timeout) {
  const auto now = Clock::now();
  return timeout < Clock::time_point::max() - now ? now + timeout : Clock::time_point::max();
}

Options checked(const Options& options) {
  const auto require = [](bool ok, const std::string& text) {
    if (!ok) throw Error(ErrorCode::invalid_argument, text);
  };
  require(options.timeout.count() > 0,
          "timeout: expected a time above 0, got " + std::to_string(options.timeout.count()) + " ms");
  require(options.tls || options.ca_file.empty(), "ca_file: expected none without tls, got \"" + options.ca_file + '"');
  require(options.tls || options.host_name.empty(), "host_name: expected none without tls, got \"" + options.host_name + '"');
  require(options.max_message_bytes > 0, "max_message_bytes: expected a number above 0, got 0");
  return options;
}

ErrorCode code_of(protocol::Code code) {
  return code == protocol::Code::kCodeUnspecified ? ErrorCode::internal : static_cast<ErrorCode>(code);
}
static_assert(static_cast<int>(ErrorCode::invalid_argument) == static_cast<int>(protocol::Code::kInvalidArgument) &&
              static_cast<int>(ErrorCode::internal) == static_cast<int>(protocol::Code::kInternal));

}  // namespace

Link::Link(const Options& options) : options_(checked(options)) {
  const Clock::time_point deadline = after(options_.timeout);
  transport_ = make_transport(options_, deadline);
  transport_->open({.opened = [this] { is_open_ = true; },
                    .received = [this](Message& message) { receive(message); },
                    .failed = [this](ErrorCode code, const std::string& text) { fail(code, text); }});
  Lock lock(mutex_);
  advance(false);
  if (!run_until(lock, [&] { return is_open_; }, deadline)) throw failure();
}

Link::~Link() {
  if (!failure_ && !is_sending_) transport_->close();
}

void Link::introduce() {
  protocol::Request request;
  request.operation = protocol::Hello{.protocol = protocol::kVersion, .token = options_.token, .client = options_.program};
  const std::shared_ptr<Call> call = send(std::move(request));
  wait(*call);
  const std::unique_ptr<ReceivedReply> reply = take(*call);
  const auto* const answer = std::get_if<protocol::Welcome>(&reply->header.result);
  if (answer == nullptr)
    throw Error(ErrorCode::bad_reply, "no flockstep server at " + options_.address + ": it does not answer Hello");
  const protocol::Welcome& welcome = *answer;
  if (welcome.protocol != protocol::kVersion) {
    throw Error(ErrorCode::failed_precondition, "protocol: expected version " + std::to_string(protocol::kVersion) +
                                                    ", which this client has, got " + std::to_string(welcome.protocol) +
                                                    " of the server (flockstep " + welcome.version +
                                                    "); install the same version on both sides");
  }
  server_ = value_of(welcome);
}

bool Link::is_open() const {
  const std::scoped_lock lock(mutex_);
  return !failure_;
}

// ------------------------------------------------------------------------------------------------------------------ requests

std::shared_ptr<Call> Link::send(protocol::Request request, const AddArrays& add) { return start(std::move(request), add, {}); }

std::shared_ptr<Call> Link::subscribe(protocol::Subscribe what) {
  protocol::Request request;
  request.operation = std::move(what);
  return start(std::move(request), {}, {.is_stream = true});
}

void Link::unsubscribe(std::uint64_t stream) {
  {
    const Lock lock(mutex_);
    if (failure_ || !expected_.contains(stream)) return;
  }
  protocol::Request request;
  request.operation = protocol::Unsubscribe{.stream = stream};
  start(std::move(request), {}, {.stream = stream});
}

std::shared_ptr<Call> Link::start(protocol::Request request, const AddArrays& add, Expected expected) {
  const Clock::time_point deadline = after(options_.timeout);
  const auto is_sent = [this] { return !is_sending_; };
  Lock lock(mutex_);
  if (failure_ || !run_until(lock, is_sent, deadline)) throw failure();
  writer_.clear();
  if (add) add(writer_);
  request.id = last_id_ + 1;
  writer_.finish(request);
  auto call = std::make_shared<Call>(shared_from_this(), request.id, expected.is_stream);
  expected.call = call->state_;
  expected_.emplace(request.id, std::move(expected));
  last_id_ = request.id;
  is_sending_ = true;
  transport_->send(writer_.header(), writer_.values(), [this] { is_sending_ = false; });
  advance(false);
  if (!run_until(lock, is_sent, deadline)) {
    const Error error = failure();
    lock.unlock();  // before ~Call()
    throw error;
  }
  return call;
}

// ------------------------------------------------------------------------------------------------------------------- waiting

template <class IsDone>
bool Link::run_until(Lock& lock, IsDone is_done, Clock::time_point deadline) {
  while (!is_done()) {
    if (failure_) return false;
    const bool is_late = Clock::now() >= deadline;
    if (is_late) {
      if (!is_polling_) advance(true);  // once, whatever the timeout
      return is_done();
    }
    if (is_polling_) {
      changed_.wait_until(lock, deadline);
      continue;
    }
    is_polling_ = true;
    const bool for_write = transport_->wants_to_write();
    lock.unlock();
    const bool may_read = transport_->socket().wait(for_write, waker_, deadline);
    lock.lock();
    is_polling_ = false;
    advance(may_read);
    changed_.notify_all();
  }
  return true;
}

void Link::advance(bool may_read) {
  transport_->advance(may_read);
  if (is_polling_) waker_.wake();  // another thread waits for what may have arrived, or has to wait for more now
}

bool Link::wait_for(const Call& call, std::chrono::nanoseconds timeout) {
  const CallState& state = *call.state_;
  const auto is_done = [&] { return state.reply != nullptr || state.was_taken || state.error.has_value(); };
  Lock lock(mutex_);
  if (call.is_stream_ && !is_polling_ && !failure_) advance(true);  // the newest value counts
  run_until(lock, is_done, after(timeout));
  if (state.reply != nullptr || state.was_taken) return true;
  if (state.error) throw Error(*state.error);
  if (failure_) throw Error(*failure_);
  return false;
}

void Link::wait(const Call& call) {
  if (wait_for(call, options_.timeout)) return;
  const Lock lock(mutex_);
  throw failure();
}

std::unique_ptr<ReceivedReply> Link::take(const Call& call) {
  const Lock lock(mutex_);
  if (call.state_->reply == nullptr) throw Error(ErrorCode::failed_precondition, "get(): the result was taken before");
  call.state_->was_taken = !call.is_stream_;
  return std::move(call.state_->reply);
}

void Link::reuse(Message memory) noexcept {
  constexpr std::size_t kMaxBytes = std::size_t{1} << 20;
  if (memory.capacity() > kMaxBytes) return;
  memory.clear();
  const Lock lock(mutex_);
  spare_ = std::move(memory);
}

Error Link::failure() const {
  if (failure_) return *failure_;
  return Error(ErrorCode::timeout,
               "the server at " + options_.address + " did not reply within " + std::to_string(options_.timeout.count()) + " ms");
}

// ------------------------------------------------------------------------------------------------------------------- replies

void Link::receive(Message& message) {
  try {
    const std::string_view bytes(static_cast<const char*>(message.data().data()), message.size());
    const std::size_t header = protocol::header_size<protocol::Reply>(bytes);
    if (bytes.size() < sizeof(std::uint32_t) || bytes.size() - sizeof(std::uint32_t) < header) {
      throw std::invalid_argument("a message is cut short");
    }
    auto reply = std::make_unique<ReceivedReply>();
    protocol::read_header(bytes, reply->header);
    reply->arrays = protocol::read_arrays(bytes, reply->header.arrays);
    reply->bytes = std::exchange(message, std::exchange(spare_, Message()));  // the memory stays where it is
    take_reply(std::move(reply));
  } catch (const std::exception& error) {
    fail(ErrorCode::bad_reply, std::string("the server does not speak this client's protocol: ") + error.what());
  }
}

void Link::take_reply(std::unique_ptr<ReceivedReply> reply) {
  const auto* const error = std::get_if<protocol::Error>(&reply->header.result);
  const auto found = expected_.find(reply->header.id);
  if (found == expected_.end()) {
    if (error != nullptr) return fail(code_of(error->code), error->text);
    throw std::invalid_argument("a reply to request " + std::to_string(reply->header.id) + ", which was not sent");
  }
  const std::shared_ptr<CallState> call = found->second.call.lock();
  if (found->second.stream != 0) expected_.erase(found->second.stream);
  if (!found->second.is_stream || error != nullptr) expected_.erase(reply->header.id);
  if (call == nullptr) return;
  if (error != nullptr) {
    call->error.emplace(code_of(error->code), error->text);
  } else {
    call->reply = std::move(reply);
  }
}

void Link::fail(ErrorCode code, const std::string& text) {
  if (failure_) return;
  failure_.emplace(code, text);
  transport_->socket().shut_down();
}

// --------------------------------------------------------------------------------------------------------------------- calls

Call::Call(std::shared_ptr<Link> link, std::uint64_t id, bool is_stream)
    : link_(std::move(link)), id_(id), is_stream_(is_stream) {}

Call::~Call() {
  if (!is_stream_) return;
  try {
    link_->unsubscribe(id_);
  } catch (...) {  // the connection has ended, and the stream with it
  }
}

void wait(Call& call) { call.link().wait(call); }

bool wait_for(Call& call, std::chrono::nanoseconds timeout) { return call.link().wait_for(call, timeout); }

}  // namespace flockstep::client::detail

namespace flockstep::client {

Connection::Connection(const Options& options) : link_(std::make_shared<detail::Link>(options)) { link_->introduce(); }

const ServerInfo& Connection::server() const { return link_->server(); }
bool Connection::is_open() const { return link_->is_open(); }

}  // namespace flockstep::client
