#include "flockstep/learner.hpp"

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cstdint>
#include <exception>
#include <memory>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "arrays.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace {

// Shape of the actions of `leading` rows.
Shape action_shape(const Learner& learner, Shape leading) {
  if (!learner.config().is_discrete) leading.push_back(learner.config().action_size);
  return leading;
}

// Arrays of the rollout are copied, because the next rollout may move them.
py::array_t<float> rollout_array(std::span<const float> values, Shape shape) {
  if (values.empty()) shape[0] = 0;  // before the first rollout
  return py::array_t<float>(shape, values.data());
}

Shape steps_and_rows(const Learner& learner) {
  return {py::ssize_t{learner.rollout_config().n_steps}, py::ssize_t{learner.rows()}};
}

Input<float> observations(const Learner& learner, const py::object& observation, const char* name, py::ssize_t rows = -1,
                          int without = 0) {
  Input<float> input = floats(observation, name, {rows, py::ssize_t{learner.config().observation_size - without}});
  if (!input.given()) throw py::value_error(std::string(name) + ": expected an array of real numbers, got None");
  return input;
}

// Returns critic_only if observations to act on are without these numbers, else 0.
int left_out(const Learner& learner, const py::object& observation) {
  const int critic_only = learner.config().critic_only;
  if (critic_only == 0) return 0;
  const auto array = py::array::ensure(observation);
  const bool is_actors_part = array && array.ndim() == 2 && array.shape(1) == learner.config().observation_size - critic_only;
  return is_actors_part ? critic_only : 0;
}

// kFill writes the rows of an array: actions, which have this shape, or values.
template <auto kFill, class AnyLearner>
py::array_t<float> filled(AnyLearner& learner, const py::object& observation, const Shape& row, int without = 0) {
  const Input<float> input = observations(learner, observation, "observation", -1, without);
  Shape shape{static_cast<py::ssize_t>(input.rows())};
  shape.insert(shape.end(), row.begin(), row.end());
  py::array_t<float> array(shape);
  const std::span<float> out(array.mutable_data(), static_cast<std::size_t>(array.size()));
  released([&] { (learner.*kFill)(input, out); });
  return array;
}

py::array_t<float> predict(const Learner& learner, const py::object& observation) {
  return filled<&Learner::predict>(learner, observation, action_shape(learner, {}), left_out(learner, observation));
}

py::array_t<float> sample(Learner& learner, const py::object& observation) {
  return filled<&Learner::sample>(learner, observation, action_shape(learner, {}), left_out(learner, observation));
}

py::array_t<float> values(const Learner& learner, const py::object& observation) {
  return filled<&Learner::values>(learner, observation, {});
}

py::array_t<float> act(Learner& learner, int t, const py::object& observation, const py::object& skipped) {
  const Input<float> input = observations(learner, observation, "observation", learner.rows());
  const Input<std::uint8_t> unused = flags(skipped, "skipped", learner.rows());
  const std::span<const float> action = released([&] { return learner.act(t, input, unused); });
  return py::array_t<float>(action_shape(learner, {py::ssize_t{learner.rows()}}), action.data());
}

void record(Learner& learner, int t, const py::object& reward, const py::object& terminated, const py::object& truncated,
            const py::object& final_observation, const py::object& skipped) {
  const py::ssize_t rows = learner.rows();
  const Input<float> rewards = floats(reward, "reward", {rows});
  const Input<std::uint8_t> ended = flags(terminated, "terminated", rows), cut = flags(truncated, "truncated", rows);
  const Input<float> final_ones =
      floats(final_observation, "final_observation", {rows, py::ssize_t{learner.config().observation_size}});
  const Input<std::uint8_t> unused = flags(skipped, "skipped", rows);
  released([&] { learner.record(t, {rewards, ended, cut, final_ones, unused}); });
}

UpdateReport update(Learner& learner, const UpdateConfig& config, const py::object& order) {
  const Input<std::int64_t> steps = integers<std::int64_t>(order, "order", {-1});
  return released([&] { return learner.update(config, steps); });
}

py::array_t<float> gradient(Learner& learner, const UpdateConfig& config, const py::object& minibatch) {
  const Input<std::int64_t> steps = integers<std::int64_t>(minibatch, "minibatch", {-1});
  return array_of(released([&] { return learner.gradient(config, steps); }));
}

py::tuple moments_of(const RunningMoments& moments) {
  return py::make_tuple(array_of(moments.mean), array_of(moments.variance), moments.count);
}

using Moments = std::tuple<std::vector<double>, std::vector<double>, double>;

RunningMoments moments_from(Moments moments) {
  return {std::move(std::get<0>(moments)), std::move(std::get<1>(moments)), std::get<2>(moments)};
}

}  // namespace

void register_learner(py::module_& module) {
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const NotFiniteError& error) {
      PyErr_SetString(PyExc_FloatingPointError, error.what());
    }
  });
  using Array = std::span<const float> (Learner::*)() const;
  py::class_<Learner> cls(module, "Learner");
  cls.def(py::init([](NetworkConfig config, int num_threads, std::uint64_t seed) {
            auto learner = std::make_unique<Learner>(std::move(config), num_threads, seed);
            const int made = learner->num_threads();
            const std::string warning = "num_threads=" + std::to_string(num_threads) + ": " + std::to_string(made) +
                                        " threads will run, at most four per processor";
            if (made < num_threads && PyErr_WarnEx(PyExc_RuntimeWarning, warning.c_str(), 1) != 0) throw py::error_already_set();
            return learner;
          }),
          py::arg("config"), py::arg("num_threads") = 0, py::arg("seed") = 0)
      .def_property_readonly("config", [](const Learner& learner) { return learner.config(); })
      .def_property_readonly("num_threads", &Learner::num_threads)
      .def_property_readonly("seed", &Learner::seed)
      .def_property_readonly("rows", &Learner::rows)
      .def_property_readonly("layout",
                             [](const Learner& learner) {
                               py::list all;
                               for (const ParameterInfo& info : learner.parameter_infos()) {
                                 all.append(py::make_tuple(info.name, py::tuple(py::cast(info.shape)), info.first));
                               }
                               return all;
                             })
      .def_property(
          "parameters", [](const Learner& learner) { return array_of(learner.parameters()); },
          [](Learner& learner, const py::object& values) { learner.set_parameters(floats(values, "parameters", {-1})); })
      .def_property_readonly("adam",
                             [](const Learner& learner) {
                               return py::make_tuple(array_of(learner.first_moments()), array_of(learner.second_moments()),
                                                     learner.adam_steps());
                             })
      .def(
          "set_adam",
          [](Learner& learner, const py::object& adam_m, const py::object& adam_v, std::int64_t steps) {
            learner.set_adam(floats(adam_m, "adam_m", {-1}), floats(adam_v, "adam_v", {-1}), steps);
          },
          py::arg("adam_m"), py::arg("adam_v"), py::arg("steps"))
      .def_property("draws", &Learner::draws, &Learner::set_draws)
      .def_property_readonly("observation_moments",
                             [](const Learner& learner) { return moments_of(learner.observation_moments()); })
      .def_property_readonly("return_moments", [](const Learner& learner) { return moments_of(learner.return_moments()); })
      .def(
          "set_moments",
          [](Learner& learner, Moments observation, Moments returns) {
            learner.set_moments(moments_from(std::move(observation)), moments_from(std::move(returns)));
          },
          py::arg("observation"), py::arg("returns"))
      .def("predict", &predict, py::arg("observation"))
      .def_property(
          "discounted_returns", [](const Learner& learner) { return array_of(learner.discounted_returns()); },
          [](Learner& learner, const std::vector<double>& values) { learner.set_discounted_returns(values); })
      .def("sample", &sample, py::arg("observation"))
      .def("values", &values, py::arg("observation"))
      .def("begin", &Learner::begin, py::arg("config"), py::arg("rows"))
      .def("act", &act, py::arg("t"), py::arg("observation"), py::arg("skipped") = py::none())
      .def("record", &record, py::arg("t"), py::arg("reward"), py::arg("terminated"), py::arg("truncated"),
           py::arg("final_observation") = py::none(), py::arg("skipped") = py::none())
      .def(
          "finish",
          [](Learner& learner, const py::object& observation) {
            const Input<float> input = observations(learner, observation, "observation", learner.rows());
            released([&] { learner.finish(input); });
          },
          py::arg("observation"))
      .def(
          "fly",
          [](Learner& learner, int t, Batch& batch, float reward_scale) {
            released(batch, [&] { learner.fly(t, batch, reward_scale); });
          },
          py::arg("t"), py::arg("batch"), py::arg("reward_scale") = 1.0F)
      .def(
          "read_observation",
          [](const Learner& learner, const Batch& batch) {
            py::array_t<float> observation({py::ssize_t{learner.rows()}, py::ssize_t{learner.config().observation_size}});
            learner.read_observation(batch, {observation.mutable_data(), static_cast<std::size_t>(observation.size())});
            return observation;
          },
          py::arg("batch"))
      .def(
          "learn_window",
          [](Learner& learner, const GradientConfig& config, Batch& batch) {
            GradientReport report;
            released(batch, [&] { report = learner.learn_window(config, batch); });
            return report;
          },
          py::arg("config"), py::arg("batch"))
      .def(
          "require_derivatives",
          [](const Learner& learner, const GradientConfig& config, Batch& batch) {
            released(batch, [&] { learner.require_derivatives(config, batch); });
          },
          py::arg("config"), py::arg("batch"))
      .def("window_gradient", [](const Learner& learner) { return array_of(learner.window_gradient()); })
      .def("update", &update, py::arg("config"), py::arg("order") = py::none())
      .def("gradient", &gradient, py::arg("config"), py::arg("minibatch"))
      .def_property_readonly("actions", [](const Learner& learner) {
        return rollout_array(learner.actions(), action_shape(learner, steps_and_rows(learner)));
      });
  const auto add = [&](const char* name, Array array) {
    cls.def_property_readonly(
        name, [array](const Learner& learner) { return rollout_array((learner.*array)(), steps_and_rows(learner)); });
  };
  add("advantages", &Learner::advantages);
  add("returns", &Learner::returns);
  add("rewards", &Learner::rewards);
  add("rollout_values", &Learner::rollout_values);
  add("log_probs", &Learner::log_probs);
}

}  // namespace flockstep::bindings
