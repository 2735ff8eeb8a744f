#include "base/excerpt.hpp"

#include <cstddef>
#include <cstdint>

namespace flockstep {
namespace {

// Returns the length in bytes of the first character of the text; 0 if it is not valid UTF-8.
std::size_t bytes_of_character(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<std::uint8_t>(text[i]); };
  const std::uint8_t lead = byte(0);
  if (lead < 0x80) return 1;
  const std::size_t count = lead >= 0xC2 && lead < 0xE0 ? 2 : (lead & 0xF0U) == 0xE0 ? 3 : lead >= 0xF0 && lead < 0xF5 ? 4 : 0;
  if (count == 0 || text.size() < count) return 0;
  for (std::size_t i = 1; i < count; ++i) {
    if ((byte(i) & 0xC0U) != 0x80) return 0;
  }
  // Rejects overlong forms, surrogates and code points above the last one.
  if ((lead == 0xE0 && byte(1) < 0xA0) || (lead == 0xED && byte(1) > 0x9F) || (lead == 0xF0 && byte(1) < 0x90) ||
      (lead == 0xF4 && byte(1) > 0x8F)) {
    return 0;
  }
  return count;
}

}  // namespace

std::string excerpt(std::string_view text, std::size_t max_bytes) {
  std::string shown;
  while (!text.empty()) {
    const std::size_t count = bytes_of_character(text);
    const bool is_printable = count > 1 || (count == 1 && text[0] >= ' ' && text[0] != '\x7F');
    const std::string_view character = is_printable ? text.substr(0, count) : "?";
    if (shown.size() + character.size() > max_bytes) return shown + "...";
    shown += character;
    text.remove_prefix(count == 0 ? 1 : count);
  }
  return shown;
}

std::string quoted_excerpt(std::string_view text) { return '"' + excerpt(text) + '"'; }

std::string counted(std::size_t count, const char* singular, const char* plural) {
  return std::to_string(count) + ' ' + (count == 1 ? singular : plural);
}

}  // namespace flockstep
