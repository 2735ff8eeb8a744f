#include "client/transport.hpp"

#include <array>
#include <boost/asio/ssl.hpp>
#include <boost/beast/ssl.hpp>
#include <boost/beast/websocket/ssl.hpp>
#include <optional>
#include <string_view>
#include <type_traits>

#include "client/byte_stream.hpp"
#include "flockstep/version.hpp"

namespace flockstep::client {
namespace {

namespace ssl = asio::ssl;
namespace websocket = beast::websocket;

using TlsStream = ssl::stream<ByteStream>;

template <class Stream>
class WebSocket final : public Transport {
  static constexpr bool kHasTls = std::is_same_v<Stream, TlsStream>;

 public:
  template <class... Arguments>
  WebSocket(const Options& options, const Address& address, std::unique_ptr<Pump> pump, Arguments&... arguments)
      : address_(address.text), host_(address.host.empty() ? "localhost" : address.host), pump_(std::move(pump)) {
    stream_.emplace(ByteStream(*pump_), arguments...);
    stream_->binary(true);
    stream_->auto_fragment(false);
    stream_->write_buffer_bytes(std::size_t{1} << 16);
    stream_->read_message_max(options.max_message_bytes);
    stream_->set_option(websocket::stream_base::decorator(
        [](websocket::request_type& request) { request.set(beast::http::field::user_agent, "flockstep " FLOCKSTEP_VERSION); }));
    if constexpr (kHasTls) {
      const std::string& name = options.host_name.empty() ? host_ : options.host_name;
      SSL* const tls = stream_->next_layer().native_handle();
      boost::system::error_code is_no_number;
      asio::ip::make_address(name, is_no_number);
      if (is_no_number) {
        SSL_set1_host(tls, name.c_str());
        SSL_set_tlsext_host_name(tls, name.c_str());
      } else {
        X509_VERIFY_PARAM_set1_ip_asc(SSL_get0_param(tls), name.c_str());
      }
    }
  }
  ~WebSocket() override {
    events_ = {};
    pump_->cancel();
    stream_.reset();
  }
  WebSocket(const WebSocket&) = delete;
  WebSocket& operator=(const WebSocket&) = delete;

  void open(Events events) override {
    events_ = std::move(events);
    if constexpr (kHasTls) {
      pump_->begin();
      stream_->next_layer().async_handshake(ssl::stream_base::client, [this](beast::error_code error) {
        pump_->end();
        if (error) return fail(tls_problem(error));
        open_websocket();
      });
    } else {
      open_websocket();
    }
  }

  void send(std::string_view header, std::string_view values, std::function<void()> sent) override {
    const std::array<asio::const_buffer, 2> parts{asio::buffer(header), asio::buffer(values)};
    pump_->begin();
    stream_->async_write(parts, [this, sent = std::move(sent)](beast::error_code error, std::size_t) {
      pump_->end();
      if (error) return fail(problem(error));
      sent();
    });
  }

  void close() override {
    if (has_failed_ || !stream_->is_open()) return;
    pump_->begin();
    stream_->async_close(websocket::close_code::normal, [this](beast::error_code) { pump_->end(); });
    pump_->run(false);
  }

  void advance(bool may_read) override { pump_->run(may_read); }
  bool wants_to_write() const override { return pump_->wants_to_write(); }
  Socket& socket() override { return pump_->socket(); }

 private:
  void open_websocket() {
    pump_->begin();
    stream_->async_handshake(host_, "/", [this](beast::error_code error) {
      pump_->end();
      if (error) return fail(handshake_problem(error));
      if (events_.opened) events_.opened();
      read();
    });
  }

  void read() {
    pump_->begin();
    stream_->async_read(message_, [this](beast::error_code error, std::size_t) {
      pump_->end();
      if (error) return fail(problem(error));
      if (events_.received) events_.received(message_);
      if (!has_failed_) read();
    });
  }

  void fail(const std::pair<ErrorCode, std::string>& problem) {
    if (std::exchange(has_failed_, true) || !events_.failed) return;
    events_.failed(problem.first, problem.second);
  }

  std::string no_server() const { return "no flockstep server at " + address_ + ": "; }

  std::pair<ErrorCode, std::string> tls_problem(const beast::error_code& error) {
    const long verdict = verify_result();
    if (verdict != X509_V_OK) {
      return {ErrorCode::unavailable, "the certificate of the server at " + address_ +
                                          " is not trusted: " + X509_verify_cert_error_string(verdict) +
                                          ". Options::ca_file names the certificates to trust, host_name the name to expect"};
    }
    return {ErrorCode::unavailable,
            no_server() + "TLS failed: " + error.message() + ". If the server has no certificate, leave out Options::tls"};
  }
  long verify_result() {
    if constexpr (kHasTls) return SSL_get_verify_result(stream_->next_layer().native_handle());
    return X509_V_OK;
  }

  std::pair<ErrorCode, std::string> handshake_problem(const beast::error_code& error) const {
    const bool is_silent =
        error == asio::error::eof || error == asio::error::connection_reset || error == beast::http::error::end_of_stream;
    if (is_silent) {
      return {ErrorCode::unavailable,
              no_server() + "it closed the connection" + (kHasTls ? "" : ". If the server has a certificate, set Options::tls")};
    }
    return {ErrorCode::bad_reply, no_server() + "it does not answer as a WebSocket: " + error.message()};
  }

  std::pair<ErrorCode, std::string> problem(const beast::error_code& error) const {
    if (error == websocket::error::closed) {
      const std::string_view reason(stream_->reason().reason.data(), stream_->reason().reason.size());
      return {ErrorCode::unavailable,
              "the server at " + address_ + " closed the connection" + (reason.empty() ? "" : ": " + std::string(reason))};
    }
    if (error == websocket::error::message_too_big) {
      return {ErrorCode::resource_exhausted, "the server sent a message that is longer than Options::max_message_bytes"};
    }
    const bool is_foreign = error == websocket::condition::protocol_violation;
    if (is_foreign) return {ErrorCode::bad_reply, "the server at " + address_ + " violates WebSocket: " + error.message()};
    const bool is_end = error == asio::error::eof || error == ssl::error::stream_truncated;
    return {ErrorCode::unavailable, "the server at " + address_ + " is gone" + (is_end ? "" : ": " + error.message())};
  }

  const std::string address_, host_;
  Events events_;
  std::unique_ptr<Pump> pump_;
  std::optional<websocket::stream<Stream>> stream_;
  Message message_;
  bool has_failed_ = false;
};

ssl::context tls_context(const std::string& ca_file) {
  ssl::context context(ssl::context::tls_client);
  context.set_options(ssl::context::default_workarounds | ssl::context::no_tlsv1 | ssl::context::no_tlsv1_1);
  context.set_verify_mode(ssl::verify_peer);
  if (ca_file.empty()) {
    context.set_default_verify_paths();
    return context;
  }
  try {
    context.load_verify_file(ca_file);
  } catch (const boost::system::system_error& error) {
    throw Error(ErrorCode::invalid_argument,
                "ca_file: expected a PEM file of certificates, got \"" + ca_file + "\": " + error.what());
  }
  return context;
}

}  // namespace

std::unique_ptr<Transport> make_transport(const Options& options, Clock::time_point deadline) {
  const Address address = Address::parse(options.address);
  if (options.tls && address.host.empty())
    throw Error(ErrorCode::invalid_argument, "tls: expected false for a Unix socket, got true");
  if (!options.tls)
    return std::make_unique<WebSocket<ByteStream>>(options, address, std::make_unique<Pump>(Socket(address, deadline)));
  ssl::context context = tls_context(options.ca_file);  // which its streams share
  return std::make_unique<WebSocket<TlsStream>>(options, address, std::make_unique<Pump>(Socket(address, deadline)), context);
}

}  // namespace flockstep::client
