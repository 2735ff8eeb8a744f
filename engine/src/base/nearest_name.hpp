// Finds the most likely intended name for a misspelt one.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace flockstep {

// Returns the share of characters that two names have in common, in [0, 1], by the method of J. W. Ratcliff and J. A.
// Obershelp: twice the length of their longest common substring, and recursively of those to its left and right, over the total
// length of both names. For names of less than 200 characters the result equals ratio() of Python's difflib.SequenceMatcher.
double name_similarity(std::string_view a, std::string_view b);

// Returns the public names that were renamed, each with the present one.
std::span<const std::pair<std::string_view, std::string_view>> renamed();

// Returns the most similar known name; of a known path, the last part also counts: hall is similar to
// arena/hall. lr is similar to learning_rate. Returns an empty string if no similarity reaches 0.6, or if the name is longer than
// 100 characters.
std::string_view nearest_name(std::string_view name, std::span<const std::string_view> known);

// Returns at most this many known names with a similarity of at least 0.6, the most similar first.
std::vector<std::string_view> nearest_names(std::string_view name, std::span<const std::string_view> known, std::size_t most);

// Returns a suffix for a message, such as ". Did you mean frame_skip?", or an empty string.
std::string did_you_mean(std::string_view name, std::span<const std::string_view> known);

}  // namespace flockstep
