#include "flockstep/limits.hpp"

#include <cmath>
#include <sstream>

namespace flockstep {

std::string Limits::text() const {
  std::ostringstream text;
  text.precision(10);
  const bool has_least = std::isfinite(least), has_greatest = std::isfinite(greatest);
  if (num_choices > 0) {
    for (std::size_t i = 0; i < num_choices; ++i) text << (i == 0 ? "" : i + 1 == num_choices ? " or " : ", ") << choices[i];
  } else if (has_least && least == -greatest && !excludes_least && !excludes_greatest) {
    text.precision(6);
    text << "within +-" << greatest;
  } else if (has_least && has_greatest) {
    text << "in " << (excludes_least ? '(' : '[') << least << ", " << greatest << (excludes_greatest ? ')' : ']');
  } else if (has_least) {
    text << (excludes_least ? "> " : ">= ") << least;
  } else if (has_greatest) {
    text << (excludes_greatest ? "< " : "<= ") << greatest;
  }
  return text.str();
}

}  // namespace flockstep
