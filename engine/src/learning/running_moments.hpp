// Running mean and variance, by rows of numbers.
#pragma once

#include <cstddef>

#include "flockstep/learner.hpp"

namespace flockstep::learning {

// Mean 0 and variance 1 of `size` numbers.
RunningMoments initial_moments(std::size_t size);

// Takes rows of numbers into account: T. F. Chan, G. H. Golub, R. J. LeVeque, "Updating formulae and a pairwise algorithm for
// computing sample variances", COMPSTAT 1982. values: (rows, size).
void take(RunningMoments& moments, const float* values, std::size_t rows);
void take(RunningMoments& moments, const double* values, std::size_t rows);

}  // namespace flockstep::learning
