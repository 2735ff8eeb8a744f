#include "service/session.hpp"

#include <algorithm>
#include <array>
#include <sstream>
#include <type_traits>
#include <utility>
#include <variant>

#include "flockstep/version.hpp"

namespace flockstep::server {
namespace {

using protocol::Code;

constexpr std::size_t kMaxHelloBytes = 4096;
constexpr std::chrono::seconds kHelloTime{10};
constexpr std::size_t kLargeMessage = std::size_t{1} << 20;    // bytes that take long to copy
constexpr std::size_t kMaxOutbox = 256;                        // messages; then nothing more is read until the client reads
constexpr std::size_t kMaxOutboxBytes = std::size_t{1} << 24;  // then no request is answered until the client reads
constexpr std::size_t kMaxUnansweredBytes = kMaxOutboxBytes;   // then nothing more is read until requests are answered
constexpr std::size_t kGrowth = 32;  // bytes that a decoded header has for each received one, at most: empty names, for example
constexpr std::size_t kMaxSubscriptions = 64;  // per client
constexpr double kMaxStreamHz = 1000.0;

// Compares in a time that does not depend on where the texts differ.
bool is_equal(const std::string& a, const std::string& b) {
  unsigned difference = a.size() == b.size() ? 0U : 1U;
  for (std::size_t i = 0; i < a.size(); ++i) {
    difference |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b.empty() ? 0 : b[i % b.size()]);
  }
  return difference == 0;
}

// Bytes that a waiting call keeps.
std::size_t memory_of(const Call& call) {
  return call.bytes.size() + kGrowth * protocol::header_size<protocol::Request>(call.bytes);
}

}  // namespace

void Stream::read(const asio::mutable_buffer& buffer, Then&& then) {
  if (tls_) return tls_->async_read_some(buffer, std::move(then));
  socket_.async_read_some(buffer, std::move(then));
}

void Stream::write(const Written& buffers, Then&& then) {
  if (tls_) return tls_->async_write_some(buffers, std::move(then));
  if (ahead_ == 0 && announced_[0].size() > 0) send_ahead(buffers);
  if (ahead_ == 0) return socket_.async_write_some(buffers, std::move(then));
  const std::size_t sent = std::min(ahead_, asio::buffer_size(buffers));
  ahead_ -= sent;
  asio::post(get_executor(), beast::bind_front_handler(std::move(then), beast::error_code(), sent));
}

void Stream::tear_down(beast::role_type role, Then&& then) {
  if (tls_) return beast::async_teardown(role, *tls_, std::move(then));
  beast::websocket::async_teardown(role, socket_, std::move(then));
}

void Stream::send_ahead(const Written& buffers) {
  if (buffers[1].data() != announced_[0].data() || !socket_.non_blocking()) return;  // a pong, say
  beast::error_code error;  // such as a full socket: then the usual way waits, or fails too
  ahead_ = socket_.write_some(std::array{buffers[0], announced_[0], announced_[1]}, error);
  announced_ = {};
}

Session::Session(Sessions& sessions, Stream::Socket socket, asio::ssl::context* tls)
    : sessions_(sessions),
      socket_(std::move(socket), tls),
      hello_timer_(socket_.get_executor()),
      idle_timer_(socket_.get_executor()) {
  ++sessions_.count;
}

Session::~Session() {
  --sessions_.count;
  if (is_open_) --sessions_.num_open;  // calls hold their session: operations that run or wait count as clients
}

// ----------------------------------------------------------------------------------------------------------------- beginning

void Session::start() {
  in_strand([self = self()] {
    self->hello_timer_.expires_after(kHelloTime);
    after(self->hello_timer_, [weak = self->weak_from_this()](beast::error_code error) {
      const auto late = weak.lock();
      if (!error && late && !late->is_open_) late->close(websocket::close_code::policy_error, "expected Hello within 10 s");
    });
    if (!self->socket_.next_layer().has_tls()) return self->read_upgrade();
    self->mark_.emplace(self->sessions_.workload);
    self->socket_.next_layer().async_tls_handshake([self](beast::error_code error) {
      self->mark_.reset();
      if (!error) self->read_upgrade();
    });
  });
}

void Session::read_upgrade() {
  beast::http::async_read(socket_.next_layer(), buffer_, upgrade_, [self = self()](beast::error_code error, std::size_t) {
    if (error) return;
    self->buffer_.clear();
    // A browser lets any web page connect to this machine, and says so by this field.
    if (!self->sessions_.config.token.empty() || self->upgrade_.count(beast::http::field::origin) == 0) return self->accept();
    constexpr std::string_view kForbidden =
        "HTTP/1.1 403 Forbidden\r\nConnection: close\r\n\r\na web page needs the token of a server that has one\n";
    const auto end = [self](beast::error_code, std::size_t) { self->end(); };
    asio::async_write(self->socket_.next_layer(), asio::buffer(kForbidden), Then(end));
  });
}

void Session::accept() {
  socket_.set_option(websocket::stream_base::timeout{kHelloTime, websocket::stream_base::none(), false});
  socket_.control_callback(
      [this](websocket::frame_type, beast::string_view) { last_arrival_ = std::chrono::steady_clock::now(); });
  socket_.set_option(websocket::stream_base::decorator(
      [](websocket::response_type& response) { response.set(beast::http::field::server, "flockstep " FLOCKSTEP_VERSION); }));
  socket_.binary(true);
  socket_.auto_fragment(false);
  socket_.write_buffer_bytes(std::size_t{1} << 16);
  socket_.read_message_max(kMaxHelloBytes);
  socket_.async_accept(upgrade_, [self = self()](beast::error_code error) {
    if (error) return;
    self->last_arrival_ = std::chrono::steady_clock::now();
    self->watch();
    self->read();
  });
}

void Session::open(const std::shared_ptr<Call>& call) {
  const auto* const hello = std::get_if<protocol::Hello>(&call->request.operation);
  const std::uint64_t id = call->request.id;
  if (hello == nullptr) return refuse(id, Code::kFailedPrecondition, "expected Hello as the first request", true);
  if (!is_equal(hello->token, sessions_.config.token)) {
    return refuse(id, Code::kUnauthenticated, hello->token.empty() ? "token: this server requires one" : "token: wrong", true);
  }
  if (++sessions_.num_open > sessions_.config.max_clients) {
    --sessions_.num_open;
    return refuse(id, Code::kResourceExhausted,
                  "this server has " + std::to_string(sessions_.config.max_clients) + " clients, its maximum", true);
  }
  sessions_.service.welcome(*call);
  is_ending_ = std::holds_alternative<protocol::Error>(call->reply.result);
  is_open_ = !is_ending_;
  if (!is_open_) --sessions_.num_open;
  hello_timer_.cancel();
  socket_.read_message_max(protocol::kMaxMessageBytes);  // take_header() limits each operation
  call->finish();
  send(call);
}

// ------------------------------------------------------------------------------------------------------------------ requests

void Session::read() {
  if (is_reading_ || is_ending_ || is_gone) return;
  if (outbox_.size() >= kMaxOutbox || unanswered_bytes_ > kMaxUnansweredBytes) return;
  is_reading_ = true;
  constexpr std::size_t kMost = std::size_t{1} << 18;
  socket_.async_read_some(buffer_, kMost, [self = self()](beast::error_code error, std::size_t) {
    self->is_reading_ = false;
    // A session that has ended must not keep the message: it would keep the session.
    if (error || self->is_gone) return self->end();
    self->last_arrival_ = std::chrono::steady_clock::now();
    self->attempt([&] {
      if (!self->take_header()) return;
      if (self->socket_.is_message_done()) self->take_message();
      self->read();
    });
  });
}

bool Session::take_header() {
  const std::string_view bytes(static_cast<const char*>(buffer_.data().data()), buffer_.size());
  const auto refused = [&](Code code, const std::string& text) {
    refuse(incoming_ ? incoming_->id : 0, code, text, true);
    return false;
  };
  if (!socket_.got_binary()) {
    close(websocket::close_code::unknown_data, "expected binary messages");
    return false;
  }
  if (!incoming_) {
    try {
      const std::size_t header = protocol::header_size<protocol::Request>(bytes);
      if (bytes.size() < sizeof(std::uint32_t) || bytes.size() - sizeof(std::uint32_t) < header) return true;  // more will come
      incoming_.emplace();
      protocol::read_header(bytes, *incoming_);
      const std::size_t count = incoming_->arrays.size();
      if (count > protocol::kMaxRequestArrays) {
        throw std::invalid_argument("arrays: expected at most " + std::to_string(protocol::kMaxRequestArrays) + ", got " +
                                    std::to_string(count));
      }
      const std::size_t arrays = protocol::bytes_of(std::span<const protocol::Array>(incoming_->arrays));
      const std::size_t allowed = is_open_ ? sessions_.service.max_array_bytes(*incoming_) : 0;
      if (arrays > allowed) {
        return refused(Code::kResourceExhausted, "arrays: expected at most " + std::to_string(allowed) +
                                                     " bytes for this operation, got " + std::to_string(arrays));
      }
      incoming_bytes_ = sizeof(std::uint32_t) + header + arrays;
      if (incoming_bytes_ > kLargeMessage) mark_.emplace(sessions_.workload);
    } catch (const std::exception& error) {
      // The message ends where WebSocket says so: the session goes on after it.
      is_skipping_ = incoming_.has_value() && is_open_;
      refuse(incoming_ ? incoming_->id : 0, Code::kInvalidArgument, std::string("message: ") + error.what(), !is_skipping_);
      return is_skipping_;
    }
  }
  if (is_skipping_) {
    skipped_ += bytes.size();
    buffer_.consume(bytes.size());
    constexpr std::size_t kMostSkipped = std::size_t{1} << 20;
    if (skipped_ > kMostSkipped) return refused(Code::kResourceExhausted, "message: too long");
    return true;
  }
  // The buffer would copy all that it has whenever it grows, and the message would be copied out of it.
  if (incoming_bytes_ > kLargeMessage) {
    large_.append(bytes);
    buffer_.consume(bytes.size());
  }
  if (large_.size() + buffer_.size() > incoming_bytes_) {
    return refused(Code::kInvalidArgument, "message: expected " + std::to_string(incoming_bytes_) + " bytes, got more");
  }
  return true;
}

void Session::take_message() {
  if (std::exchange(is_skipping_, false)) {
    buffer_.consume(buffer_.size());
    incoming_.reset();
    skipped_ = 0;
    return;
  }
  const auto call = std::make_shared<Call>();
  call->client = self();
  call->bytes = std::exchange(large_, {});
  call->bytes.append(static_cast<const char*>(buffer_.data().data()), buffer_.size());
  buffer_.consume(buffer_.size());
  const std::size_t size = call->bytes.size();
  if (!incoming_ || size != incoming_bytes_) {
    return refuse(incoming_ ? incoming_->id : 0, Code::kInvalidArgument, "message: it is cut short", true);
  }
  call->request = std::move(*incoming_);
  incoming_.reset();
  mark_.reset();
  if (!is_open_) return open(call);
  const std::size_t unanswered = waiting_.size() + (is_busy_ ? 1 : 0);
  if (unanswered >= static_cast<std::size_t>(sessions_.config.max_requests)) {
    return refuse(call->request.id, Code::kResourceExhausted,
                  "this client has " + std::to_string(unanswered) + " unanswered requests, the maximum", false);
  }
  waiting_.push_back(call);
  unanswered_bytes_ += memory_of(*call);
  dispatch_next();
}

void Session::dispatch_next() {
  if (std::exchange(is_dispatching_, true)) return;  // a request was answered at once: the loop below goes on
  while (!is_busy_ && !waiting_.empty() && !is_gone && outbox_bytes_ <= kMaxOutboxBytes) {
    is_busy_ = true;
    const std::shared_ptr<Call> call = std::move(waiting_.front());
    waiting_.pop_front();
    busy_bytes_ = memory_of(*call);
    if (const auto* const wanted = std::get_if<protocol::Subscribe>(&call->request.operation)) {
      subscribe(call, *wanted);
    } else if (const auto* const ended = std::get_if<protocol::Unsubscribe>(&call->request.operation)) {
      unsubscribe(call, *ended);
    } else {
      sessions_.service.answer(call);
    }
  }
  is_dispatching_ = false;
}

void Session::end_request() {
  is_busy_ = false;
  unanswered_bytes_ -= std::exchange(busy_bytes_, 0);
}

void Session::deliver(const std::shared_ptr<Call>& call) {
  in_strand([self = self(), call] {
    if (!call->is_of_stream) {
      self->end_request();
    } else {
      --self->num_values_;
      const auto stream = self->subscriptions_.find(call->request.id);
      if (stream == self->subscriptions_.end()) return;  // unsubscribed in the meantime
      if (std::holds_alternative<protocol::Error>(call->reply.result)) self->subscriptions_.erase(stream);  // its end
    }
    self->attempt([&] {
      self->send(call);
      self->dispatch_next();
      self->read();
    });
  });
}

void Session::refuse(std::uint64_t id, Code code, const std::string& text, bool ends) {
  const auto call = std::make_shared<Call>();
  call->request.id = id;
  call->fail(code, text);
  call->finish();
  is_ending_ |= ends;
  send(call);
}

// ------------------------------------------------------------------------------------------------------------------- streams

void Session::subscribe(const std::shared_ptr<Call>& call, const protocol::Subscribe& subscribe) {
  const auto refused = [&](Code code, const std::string& text) {
    call->fail(code, text);
    call->finish();
    deliver(call);
  };
  const double rate = subscribe.rate_hz;
  if (!(rate >= ServerConfig::kMinRateHz && rate <= kMaxStreamHz)) {
    std::ostringstream text;
    text << "rate_hz: expected a number in [1e-06, 1000], got " << rate;
    return refused(Code::kInvalidArgument, text.str());
  }
  if (subscribe.what.index() == 0)
    return refused(Code::kInvalidArgument, "what: expected one of arrays, lidar, camera, fps, got none");
  if (std::max(subscriptions_.size(), num_values_) >= kMaxSubscriptions) {
    return refused(Code::kResourceExhausted, "this client has " + std::to_string(kMaxSubscriptions) +
                                                 " streams, the maximum; ended ones count while a value is made");
  }
  if (subscriptions_.contains(call->request.id)) {
    return refused(Code::kInvalidArgument, "id: expected one that no stream of this client has");
  }
  const auto period = std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(1.0 / rate));
  subscriptions_.emplace(call->request.id, std::make_shared<Subscription>(Subscription{
                                               .what = subscribe, .timer = Timer(socket_.get_executor()), .period = period}));
  end_request();
  subscriptions_.at(call->request.id)->timer.expires_after(std::chrono::seconds(0));
  wait_for(call->request.id);
}

void Session::wait_for(std::uint64_t id) {
  const auto found = subscriptions_.find(id);
  if (found == subscriptions_.end()) return;
  after(found->second->timer, [weak = weak_from_this(), id, stream = std::weak_ptr(found->second)](beast::error_code error) {
    const auto self = weak.lock();
    const auto subscription = stream.lock();
    if (error || !self || !subscription || self->is_gone || self->is_ending_) return;
    // The next time is a multiple of the period, unless it is late already.
    const auto now = std::chrono::steady_clock::now();
    subscription->timer.expires_at(std::max(subscription->timer.expiry() + subscription->period, now));
    self->attempt([&] {
      self->make_value(id, *subscription);
      self->wait_for(id);
    });
  });
}

void Session::make_value(std::uint64_t id, Subscription& subscription) {
  subscription.is_due = subscription.is_pending;
  const std::int64_t change = sessions_.service.changes();
  const bool is_new = !subscription.what.only_new || change != subscription.last_change;
  if (subscription.is_pending || !is_new) return;
  subscription.is_pending = true;
  subscription.last_change = change;
  const auto call = std::make_shared<Call>();
  call->client = self();
  call->is_of_stream = true;
  call->request.id = id;
  std::visit(
      [&](const auto& what) {
        if constexpr (!std::is_same_v<std::decay_t<decltype(what)>, std::monostate>) call->request.operation = what;
      },
      subscription.what.what);
  ++num_values_;
  sessions_.service.answer(call);
}

void Session::unsubscribe(const std::shared_ptr<Call>& call, const protocol::Unsubscribe& unsubscribe) {
  if (subscriptions_.erase(unsubscribe.stream) == 0) {
    call->fail(Code::kNotFound, "stream: expected the id of a Subscribe request, got " + std::to_string(unsubscribe.stream));
  } else {
    call->result<protocol::Done>();
  }
  call->finish();
  deliver(call);
}

// ------------------------------------------------------------------------------------------------------------------- replies

void Session::send(const std::shared_ptr<Call>& call) {
  if (is_gone) return;
  outbox_.push_back(call);
  outbox_bytes_ += call->writer.size();
  if (outbox_.size() == 1) write();
}

void Session::write() {
  const Call& call = *outbox_.front();
  const std::array<asio::const_buffer, 2> parts{asio::buffer(call.writer.header()), asio::buffer(call.writer.values())};
  constexpr std::size_t kOneWrite = (std::size_t{1} << 16) - 16;  // with its frame, Asio sends this at once
  if (call.writer.size() > kOneWrite) socket_.next_layer().announce(parts);
  socket_.async_write(parts, [self = self()](beast::error_code error, std::size_t) {
    if (error) {
      self->outbox_.clear();  // calls hold their session
      return self->end();
    }
    const std::shared_ptr<Call> sent = std::move(self->outbox_.front());
    self->outbox_.pop_front();
    self->outbox_bytes_ -= sent->writer.size();
    std::shared_ptr<Subscription> stream;
    if (const auto found = self->subscriptions_.find(sent->request.id);
        sent->is_of_stream && found != self->subscriptions_.end()) {
      stream = found->second;
      stream->is_pending = false;
    }
    self->attempt([&] {
      if (!self->outbox_.empty()) {
        self->write();
      } else if (self->is_ending_) {
        self->close(websocket::close_code::policy_error, "refused");
      }
      if (!self->is_ending_) self->dispatch_next();
      self->read();
      if (stream && stream->is_due && !self->is_ending_ && !self->is_gone) self->make_value(sent->request.id, *stream);
    });
  });
}

// ---------------------------------------------------------------------------------------------------------------------- end

void Session::stop(const std::string& reason) {
  in_strand([self = self(), reason] { self->close(websocket::close_code::going_away, reason); });
}

void Session::drop() {
  in_strand([self = self()] {
    if (!self->is_open_) self->end();
  });
}

void Session::close(websocket::close_code code, const std::string& reason) {
  if (is_gone || !socket_.is_open()) return end();
  is_ending_ = true;
  if (std::exchange(is_closing_, true)) return;
  socket_.async_close({code, reason}, [self = self()](beast::error_code) { self->end(); });
}

void Session::end() {
  if (is_gone.exchange(true)) return;
  hello_timer_.cancel();
  idle_timer_.cancel();
  mark_.reset();
  subscriptions_.clear();
  waiting_.clear();
  large_ = {};
  while (outbox_.size() > 1) outbox_.pop_back();  // the first one is being written
  socket_.next_layer().close();
  if (is_open_) sessions_.service.leave(self());
}

void Session::watch() {
  const auto limit = std::chrono::duration_cast<std::chrono::steady_clock::duration>(
      std::chrono::duration<double>(sessions_.config.idle_timeout_s));
  const auto silence = std::chrono::steady_clock::now() - last_arrival_;
  if (silence >= limit) return end();
  const bool is_late = silence >= limit / 2;
  if (is_late && !is_pinging_ && !is_closing_) {
    is_pinging_ = true;
    socket_.async_ping({}, [self = self()](beast::error_code) { self->is_pinging_ = false; });
  }
  idle_timer_.expires_at(last_arrival_ + (is_late ? limit : limit / 2));
  after(idle_timer_, [weak = weak_from_this()](beast::error_code error) {
    const auto self = weak.lock();
    if (!error && self && !self->is_gone) self->watch();
  });
}

}  // namespace flockstep::server
