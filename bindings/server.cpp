#include "flockstep/server.hpp"

#include <pybind11/pybind11.h>

#include <memory>
#include <string>

#include "config.hpp"
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
using Held = std::unique_ptr<Server, Ended>;

}  // namespace

void register_server(py::module_& module) {
  py::class_<Server, Held>(module, "Server", "Lets other processes see and steer the drones of a batch.")
      .def(py::init([](Batch& batch, const ServerConfig& config) {
             return released([&] { return Held(std::make_unique<Server>(batch, config).release()); });
           }),
           py::arg("batch"), py::arg("config"), py::keep_alive<1, 2>())
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
