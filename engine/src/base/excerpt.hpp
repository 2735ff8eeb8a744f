// What messages show of text that came from outside: at most so much of it, and always UTF-8.
#pragma once

#include <string>
#include <string_view>

namespace flockstep {

// The beginning of a text, "..." behind it where something is left out. No character is cut in two; bytes that are not UTF-8 and
// control characters are shown as "?".
std::string excerpt(std::string_view text, std::size_t max_bytes = 60);

// The same in quotes.
std::string quoted_excerpt(std::string_view text);

// "1 texture", "2 textures".
std::string counted(std::size_t count, const char* singular, const char* plural);

}  // namespace flockstep
