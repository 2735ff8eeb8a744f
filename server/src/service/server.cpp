#include "flockstep/server.hpp"

#include <algorithm>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <functional>
#include <mutex>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/check_fields.hpp"
#include "base/interrupt.hpp"
#include "base/platform.hpp"
#include "base/require.hpp"
#include "service/session.hpp"
#include "service/workload.hpp"

namespace flockstep {

namespace asio = boost::asio;
using tcp = asio::ip::tcp;
using server::Service;

namespace {

constexpr std::string_view kUnix = "unix:";

bool is_unix(const ServerConfig& config) { return config.address.starts_with(kUnix); }

asio::ip::address ip_address(const ServerConfig& config) {
  if (config.address == "localhost") return asio::ip::address_v4::loopback();
  boost::system::error_code error;
  const asio::ip::address address = asio::ip::make_address(config.address, error);
  require(!error, "address", "an IP address, localhost or unix:PATH", '"' + config.address + '"');
  return address;
}

ServerConfig validated(ServerConfig config) {
  config.validate();
  return config;
}

// While it exists, calls of this thread that poll for interrupts end with an exception once the flag is set.
class Cancellable {
 public:
  explicit Cancellable(const std::atomic<bool>& flag) : interrupt_(check) { current() = &flag; }
  // Returns whether this thread has run calls that this flag ends.
  static bool is_of_thread(const std::atomic<bool>& flag) { return current() == &flag; }

 private:
  static const std::atomic<bool>*& current() {
    thread_local const std::atomic<bool>* flag = nullptr;
    return flag;
  }
  static void check() {
    if (*current()) throw std::runtime_error("the server stops");
  }

  Interrupt interrupt_;
};

// Runs handlers. One that fails, for example without memory, must not end the process.
template <class Run>
void run_handlers(const Run& run) {
  try {
    run();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "flockstep server: an operation failed: %s\n", error.what());
  }
}

}  // namespace

void ServerConfig::validate() const {
  check_fields(*this, "");
  require(rate_hz == 0.0 || rate_hz >= kMinRateHz, "rate_hz", "0 or a number in [1e-06, 10000]", rate_hz);
  require(certificate_file.empty() == private_key_file.empty(),
          certificate_file.empty() ? "certificate_file" : "private_key_file",
          "both a certificate and its private key, or neither", "only one of them");
  require(token.empty() || token.find_first_not_of(" \t\r\n") != std::string::npos, "token", "a secret", "only spaces");
  if (is_unix(*this)) {
    require(address.size() > kUnix.size(), "address", "unix:PATH", '"' + address + '"');
    require(certificate_file.empty(), "certificate_file", "none for a Unix socket", '"' + certificate_file + '"');
    return;
  }
  require(ip_address(*this).is_loopback() || !token.empty(), "token",
          "a secret, because other machines reach the address " + address, "none (set FLOCKSTEP_TOKEN)");
}

class Server::Impl {
 public:
  Impl(Batch& batch, ServerConfig given)
      : config_(validated(std::move(given))),
        aside_(1),
        compression_(1),
        service_(
            batch, config_, [this](std::function<void()> work) { asio::post(io_, std::move(work)); }, runs_on(aside_),
            runs_on(compression_), workload_),
        sessions_{.service = service_, .config = config_, .workload = workload_},
        tls_(asio::ssl::context::tls_server),
        tick_timer_(asio::make_strand(io_)),
        lockstep_timer_(tick_timer_.get_executor()),
        retry_timer_(accepting_) {
    listen();
    service_.on_new_rate([this] { post([this] { schedule_tick(); }); });
    service_.on_lockstep_wait([this](std::uint64_t wait) {
      post([this, wait] {
        lockstep_timer_.expires_after(std::chrono::duration_cast<std::chrono::steady_clock::duration>(
            std::chrono::duration<double>(config_.lockstep_timeout_s)));
        server::after(lockstep_timer_, [this, wait](boost::system::error_code error) {
          if (!error) service_.end_lockstep_wait(wait);
        });
      });
    });
    service_.on_clock_failure([this](const std::string& reason) {
      if (cancels_calls_) return;
      std::fprintf(stderr, "flockstep server at %s: a step failed, and the clock stands still: %s\n", address().c_str(),
                   reason.c_str());
    });
    schedule_tick();
    accept();
    try {
      start_threads();
    } catch (...) {
      stop();
      throw;
    }
  }
  ~Impl() {
    const Interrupt none(nullptr);  // the batch must be free of this server
    stop();
  }

  void stop() {
    if (is_own_thread()) {
      throw std::logic_error("stop() was called by an operation of a client, for which it would wait: call it on another thread");
    }
    const std::scoped_lock lock(stop_mutex_);
    if (!is_stopped_.exchange(true)) end();
    service_.unshare();  // again, if an interrupt ended an earlier wait for the batch
  }

  // False in a child of the process that made the server: there it has no threads and cannot be stopped.
  bool is_own_process() const { return process_id() == owner_; }
  // True on the threads that this server has started.
  bool is_own_thread() const { return Cancellable::is_of_thread(cancels_calls_); }

  const ServerConfig& config() const { return config_; }
  int port() const { return port_; }
  std::string address() const {
    if (is_unix(config_)) return config_.address;
    const asio::ip::address address = ip_address(config_);
    return (address.is_v6() ? '[' + address.to_string() + ']' : address.to_string()) + ':' + std::to_string(port_);
  }
  int num_clients() const { return sessions_.count; }
  const Service& service() const { return service_; }

 private:
  static constexpr int kSpareConnections = 64;  // beyond the clients: for those that have not said Hello

  // Runs it later, in the strand of the timers for steps.
  void post(std::function<void()> work) { asio::post(tick_timer_.get_executor(), std::move(work)); }
  Service::Post runs_on(asio::thread_pool& thread) {
    return [this, &thread](std::function<void()> work) {
      asio::post(thread, [this, work = std::move(work)] {
        const Cancellable cancellable(cancels_calls_);
        if (!cancels_calls_) run_handlers(work);
      });
    };
  }

  void start_threads() {
    threads_.emplace_back([this] {
      const Cancellable cancellable(cancels_calls_);
      while (!io_.stopped()) run_handlers([this] { io_.run(); });
    });
    // Runs handlers while the other thread may be at work for long. If it always did, each message would wake both.
    threads_.emplace_back([this] {
      const Cancellable cancellable(cancels_calls_);
      while (workload_.wait()) {
        run_handlers([this] {
          io_.run_one();
          io_.poll();  // also runs handlers that this one has posted: the context would wake no thread for them
        });
      }
    });
  }

  // Ends connections and threads.
  void end() {
    asio::post(accepting_, [this] {
      boost::system::error_code ignored;
      if (tcp_) tcp_->close(ignored);
      if (unix_) unix_->close(ignored);
    });
    post([this] { tick_timer_.cancel(); });
    std::vector<std::weak_ptr<server::Session>> open;
    {
      const std::scoped_lock lock(list_mutex_);
      open = open_;
    }
    for (const auto& weak : open) {
      if (const auto session = weak.lock()) session->stop("the server stops");
    }
    work_.reset();
    constexpr std::chrono::milliseconds kGrace{500};
    const auto until = std::chrono::steady_clock::now() + kGrace;
    while (sessions_.count > 0 && std::chrono::steady_clock::now() < until)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    workload_.end();
    io_.stop();
    cancels_calls_ = true;
    for (std::thread& thread : threads_) thread.join();
    aside_.join();
    compression_.join();
    for (const auto& open : open_) {
      if (const auto session = open.lock()) session->shut_down();
    }
    service_.drop_calls();
    if (is_unix(config_)) {
      std::error_code ignored;
      std::filesystem::remove(config_.address.substr(kUnix.size()), ignored);
    }
  }

  void listen() {
    if (!config_.certificate_file.empty()) {
      try {
        tls_.set_options(asio::ssl::context::default_workarounds | asio::ssl::context::no_tlsv1 | asio::ssl::context::no_tlsv1_1);
        tls_.use_certificate_chain_file(config_.certificate_file);
        tls_.use_private_key_file(config_.private_key_file, asio::ssl::context::pem);
      } catch (const boost::system::system_error& error) {
        throw std::runtime_error("certificate_file, private_key_file: cannot be used: " + std::string(error.what()));
      }
    }
    try {
      if (is_unix(config_)) {
        const std::string path = config_.address.substr(kUnix.size());
        unix_.emplace(accepting_, asio::local::stream_protocol());
        unix_->bind(path);
        std::filesystem::permissions(path, std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
        unix_->listen();  // not earlier: nobody else connects before the permissions are set
      } else {
        tcp_.emplace(accepting_, tcp::endpoint(ip_address(config_), static_cast<unsigned short>(config_.port)), true);
        port_ = tcp_->local_endpoint().port();
      }
    } catch (const boost::system::system_error& error) {
      const std::string where = is_unix(config_) ? config_.address : config_.address + " port " + std::to_string(config_.port);
      const bool is_taken = error.code() == boost::system::errc::address_in_use;
      throw std::runtime_error("cannot listen on " + where + ": " + error.code().message() +
                               (!is_taken ? ""
                                : is_unix(config_)
                                    ? "; if no server runs there any more, remove the file"
                                    : "; another server may run there: choose another port, or 0 for any free one"));
    }
  }

  void accept() {
    if (tcp_) {
      accept_from(*tcp_);
    } else {
      accept_from(*unix_);
    }
  }
  template <class Acceptor>
  void accept_from(Acceptor& acceptor) {
    using Socket = asio::basic_stream_socket<typename Acceptor::protocol_type, server::Stream::executor_type>;
    acceptor.async_accept(asio::make_strand(io_), [this](boost::system::error_code error, Socket socket) {
      if (!error) run_handlers([&] { start(std::move(socket)); });
      accept_next(error);
    });
  }
  void accept_next(boost::system::error_code error) {
    const bool is_open = tcp_ ? tcp_->is_open() : unix_->is_open();
    if (!is_open || error == asio::error::operation_aborted) return;
    if (!error) return accept();
    // Too many open files, say: try again a little later.
    drop_oldest(kSpareConnections);
    retry_timer_.expires_after(std::chrono::milliseconds(100));
    server::after(retry_timer_, [this](boost::system::error_code cancelled) {
      if (!cancelled) accept();
    });
  }

  template <class Socket>
  void start(Socket socket) {
    if constexpr (std::is_same_v<typename Socket::protocol_type, tcp>) {
      boost::system::error_code ignored;
      socket.set_option(tcp::no_delay(true), ignored);
      socket.set_option(asio::socket_base::keep_alive(true), ignored);
    }
    const auto session = std::make_shared<server::Session>(sessions_, server::Stream::Socket(std::move(socket)),
                                                           config_.certificate_file.empty() ? nullptr : &tls_);
    {
      const std::scoped_lock lock(list_mutex_);
      std::erase_if(open_, [](const auto& open) { return open.expired(); });
      open_.push_back(session);
    }
    session->start();
    if (sessions_.count > config_.max_clients + kSpareConnections) drop_oldest(1);
  }

  // Ends the connections without Hello that have waited longest.
  void drop_oldest(int count) {
    const std::scoped_lock lock(list_mutex_);
    std::erase_if(open_, [&](const auto& open) {
      const auto session = count > 0 ? open.lock() : nullptr;
      if (session == nullptr || session->is_open()) return false;
      --count;
      session->drop();
      return true;
    });
  }

  void schedule_tick() {
    const double rate = service_.rate_hz();
    tick_timer_.cancel();
    if (rate <= 0.0 || is_stopped_) return;
    const auto period =
        std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(1.0 / rate));
    const auto now = std::chrono::steady_clock::now();
    next_tick_ = std::max(next_tick_ + period, now);  // what was missed is not made up for
    tick_timer_.expires_at(next_tick_);
    server::after(tick_timer_, [this](boost::system::error_code error) {
      if (error) return;
      service_.tick();
      schedule_tick();
    });
  }

  const long owner_ = process_id();
  const ServerConfig config_;
  std::atomic<bool> cancels_calls_{false};  // its address is that of the server's threads, see is_own_thread()
  server::Workload workload_;
  asio::thread_pool aside_;        // makes meshes and point clouds
  asio::thread_pool compression_;  // encodes images
  Service service_;
  server::Sessions sessions_;
  asio::ssl::context tls_;
  asio::io_context io_;  // after what the sessions in it refer to
  asio::executor_work_guard<asio::io_context::executor_type> work_{io_.get_executor()};
  asio::strand<asio::io_context::executor_type> accepting_{asio::make_strand(io_)};  // for the acceptors and retry_timer_
  std::optional<tcp::acceptor> tcp_;
  std::optional<asio::local::stream_protocol::acceptor> unix_;
  int port_ = 0;
  asio::steady_timer tick_timer_, lockstep_timer_, retry_timer_;
  std::chrono::steady_clock::time_point next_tick_{};

  std::mutex list_mutex_;
  std::vector<std::weak_ptr<server::Session>> open_;
  std::mutex stop_mutex_;
  std::atomic<bool> is_stopped_{false};
  std::vector<std::thread> threads_;
};

Server::Server(Batch& batch, ServerConfig config) {
  const auto refused = [](const std::string& reason) {
    return std::runtime_error("the system refused a thread of the server (" + reason + "); raise a limit: " + thread_limits());
  };
  constexpr auto kRefused = static_cast<int>(std::errc::resource_unavailable_try_again);
  try {
    impl_ = std::make_unique<Impl>(batch, std::move(config));
  } catch (const std::system_error& error) {
    if (error.code().value() != kRefused) throw;
    throw refused(error.code().message());
  } catch (const boost::system::system_error& error) {  // not a std::system_error in old versions
    if (error.code().value() != kRefused) throw;
    throw refused(error.code().message());
  }
}
Server::~Server() {
  if (!impl_->is_own_process()) {
    static_cast<void>(impl_.release());  // fork() copies no threads: they cannot be ended
  } else if (impl_->is_own_thread()) {
    std::thread([impl = std::move(impl_)] {}).detach();  // a thread cannot wait for its own end
  }
}

void Server::stop() {
  if (impl_->is_own_process()) impl_->stop();
}
const ServerConfig& Server::config() const { return impl_->config(); }
int Server::port() const { return impl_->port(); }
std::string Server::address() const { return impl_->address(); }
int Server::num_clients() const { return impl_->num_clients(); }
std::int64_t Server::num_requests() const { return impl_->service().answered(); }
std::int64_t Server::num_steps() const { return impl_->service().steps(); }

}  // namespace flockstep
