// Decodes Base64 (RFC 4648), as used for bytes in JSON.
#pragma once

#include <string>
#include <string_view>

namespace flockstep {

std::string base64_of(std::string_view bytes);

// Padding is optional. Throws std::invalid_argument that names the source if a character is not in the base64 alphabet.
std::string bytes_of_base64(std::string_view text, const std::string& source);

}  // namespace flockstep
