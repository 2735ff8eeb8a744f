// Server: lets other processes see and steer the drones of a batch. docs/how-to/connect/server.md explains it,
// docs/reference/protocol.md the messages.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "flockstep/batch.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// How a server listens, and what clients may do.
struct ServerConfig {
  std::string address = "127.0.0.1";
  int port = 41451;
  std::string token;
  std::string certificate_file;
  std::string private_key_file;
  bool ownership = false;
  double rate_hz = 0.0;
  int max_clients = 1024;
  int max_requests = 64;
  double idle_timeout_s = 600.0;
  double lockstep_timeout_s = 60.0;

  static constexpr double kMinRateHz = 1e-6;  // least rate of clocks and streams that run: longer periods overflow

  static constexpr auto fields() {
    using C = ServerConfig;
    return field_list(
        field(
            "address", &C::address,
            {.about = "Address to listen on: an IP address, ``\"localhost\"``, or ``\"unix:PATH\"`` for a Unix socket. Other "
                      "machines reach the server only if this is an address of the network, such as ``\"0.0.0.0\"``; a token is "
                      "then required."}),
        field("port", &C::port, {.about = "Port to listen on. 0: any free port.", .limits = between(0, 65535)}),
        field("token", &C::token, {.about = "Secret that clients must send. Empty: none."}),
        field("certificate_file", &C::certificate_file,
              {.about = "PEM file with the certificate chain. With a certificate and its key, clients connect by TLS only."}),
        field("private_key_file", &C::private_key_file, {.about = "PEM file with the private key of the certificate."}),
        field("ownership", &C::ownership, {.about = "Refuse operations that change a drone which another client has claimed."}),
        field("rate_hz", &C::rate_hz,
              {.about = "Steps per second of wall time, at least 1e-06. 0: the server steps only when clients or the program ask "
                        "for it.",
               .unit = "Hz",
               .limits = between(0, 10000)}),
        field("max_clients", &C::max_clients, {.about = "Maximum number of clients at once.", .limits = between(1, 100000)}),
        field("max_requests", &C::max_requests,
              {.about = "Maximum number of unanswered requests of a client; more are refused.", .limits = between(1, 100000)}),
        field("idle_timeout_s", &C::idle_timeout_s,
              {.about = "A connection on which nothing arrives for this long is closed. Python clients answer the server's pings "
                        "at any time, C++ clients while they wait for a reply or a stream.",
               .unit = "s",
               .limits = between(0.1, 86400)}),
        field(
            "lockstep_timeout_s", &C::lockstep_timeout_s,
            {.about = "Time that a step in lockstep waits for the other members. Those that have not called it by then leave the "
                      "lockstep.",
             .unit = "s",
             .limits = between(0.1, 86400)}));
  }

  FLOCKSTEP_API void validate() const;
};

// Serves a batch from threads of this process until it is destroyed. The program may go on calling the batch; calls of the
// program and of clients wait for each other. The batch must outlive the server.
class FLOCKSTEP_API Server {
 public:
  // Throws std::invalid_argument if the configuration is invalid, and std::runtime_error if the port is taken or a file cannot be
  // read. Begins to share the batch: see ServedBatch.
  Server(Batch& batch, ServerConfig config = {});
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  // Closes all connections and ends the threads. Clients get the reason. Further calls wait for the first one. An Interrupt while
  // the program is in a call on the batch leaves the batch shared until the next stop(). Throws std::logic_error on a thread of
  // the server, such as from a task that a client steps.
  void stop();

  const ServerConfig& config() const;  // as given
  int port() const;                    // actual port, also if config().port = 0; 0 for a Unix socket
  std::string address() const;         // to connect to: "127.0.0.1:41451", "[::1]:41451" or "unix:PATH"
  int num_clients() const;             // connected now
  std::int64_t num_requests() const;   // answered since the start
  std::int64_t num_steps() const;      // steps of the server's clock and of clients since the start

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace flockstep
