// Shortens external text for messages. The result is always valid UTF-8.
#pragma once

#include <string>
#include <string_view>

namespace flockstep {

// Returns the beginning of a text, followed by "..." if something was cut off. Characters are never split. Invalid UTF-8 bytes
// and control characters are shown as "?".
std::string excerpt(std::string_view text, std::size_t max_bytes = 60);

// Returns the excerpt in quotes.
std::string quoted_excerpt(std::string_view text);

// Returns a count with its noun: "1 texture", "2 textures".
std::string counted(std::size_t count, const char* singular, const char* plural);

}  // namespace flockstep
