#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <span>

namespace flockstep::bindings {

// Implements Batch.terms; the returned object keeps its batch alive.
pybind11::object terms_of(const pybind11::object& batch);

// Returns the rotation matrices (R, 3, 3) of quaternions (R, 4): the columns are the body's axes in the world frame.
pybind11::array_t<float> rotation_matrices(std::span<const float> quat_wxyz);

}  // namespace flockstep::bindings
