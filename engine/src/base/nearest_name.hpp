// Finds the name that a misspelt one probably means.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace flockstep {

// The share of characters that two names have in common, from 0 to 1, after J. W. Ratcliff and J. A. Obershelp: twice the length
// of their longest common substring, and of those to its left and right in turn, over the length of both. The same number as
// ratio() of Python's difflib.SequenceMatcher for names of less than 200 characters.
double name_similarity(std::string_view a, std::string_view b);

// The known name that is most similar; empty if none has a similarity of 0.6 or more, or if the name is longer than any name is.
std::string_view nearest_name(std::string_view name, std::span<const std::string_view> known);

// For the end of a message: ". Did you mean frame_skip?", or nothing.
std::string did_you_mean(std::string_view name, std::span<const std::string_view> known);

}  // namespace flockstep
