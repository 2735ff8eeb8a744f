// Base64 (RFC 4648): bytes within JSON.
#pragma once

#include <string>
#include <string_view>

namespace flockstep {

std::string base64_of(std::string_view bytes);

// Padding may be missing. Throws std::invalid_argument naming the source where a character is none of base64's 64.
std::string bytes_of_base64(std::string_view text, const std::string& source);

}  // namespace flockstep
