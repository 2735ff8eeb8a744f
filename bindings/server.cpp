#include "flockstep/server.hpp"

#include <pybind11/pybind11.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace py = pybind11;
namespace {

// Releases the interpreter lock, because the threads of the server may need it before they end.
struct Ended {
  void operator()(Server* server) const {
    const py::gil_scoped_release release;
    std::default_delete<Server>()(server);
  }
};

// All servers; needs the interpreter lock.
std::vector<std::weak_ptr<Server>>& servers() {
  static std::vector<std::weak_ptr<Server>> all;
  return all;
}

std::shared_ptr<Server> made(Batch& batch, const ServerConfig& config) {
  std::shared_ptr<Server> server = released([&] { return std::shared_ptr<Server>(new Server(batch, config), Ended()); });
  std::erase_if(servers(), [](const std::weak_ptr<Server>& other) { return other.expired(); });
  servers().push_back(server);
  return server;
}

// Called before the interpreter ends: after that, it would kill a thread of a server that calls a task in Python.
void stop_all() {
  for (const std::weak_ptr<Server>& weak : std::exchange(servers(), {})) {
    if (const std::shared_ptr<Server> server = weak.lock()) released([&] { server->stop(); });
  }
}

}  // namespace

void register_server(py::module_& module) {
  py::module_::import("atexit").attr("register")(py::cpp_function(stop_all));
  py::class_<Server, std::shared_ptr<Server>>(module, "Server", "Lets other processes see and steer the drones of a batch.")
      .def(py::init(&made), py::arg("batch"), py::arg("config"), py::keep_alive<1, 2>())
      .def("stop", [](Server& server) { released([&] { server.stop(); }); })
      .def_property_readonly("config", [](const Server& server) { return server.config(); })
      .def_property_readonly("port", &Server::port)
      .def_property_readonly("address", &Server::address)
      .def_property_readonly("num_clients", &Server::num_clients)
      .def_property_readonly("num_requests", &Server::num_requests)
      .def_property_readonly("num_steps", &Server::num_steps)
      .def("__enter__", [](py::object self) { return self; })
      .def("__exit__", [](Server& server, const py::args&) { released([&] { server.stop(); }); })
      .def("__repr__", [](const Server& server) {
        return "<Server: " + server.address() + ", " + std::to_string(server.num_clients()) + " clients>";
      });
}

}  // namespace flockstep::bindings
