#include "flockstep/limits.hpp"

#include <cmath>
#include <sstream>

namespace flockstep {

std::string Limits::text() const {
  std::ostringstream text;
  text.precision(10);
  const bool has_least = std::isfinite(least), has_greatest = std::isfinite(greatest);
  if (has_least && has_greatest) {
    text << "in " << (excludes_least ? '(' : '[') << least << ", " << greatest << (excludes_greatest ? ')' : ']');
  } else if (has_least) {
    text << (excludes_least ? "> " : ">= ") << least;
  } else if (has_greatest) {
    text << (excludes_greatest ? "< " : "<= ") << greatest;
  }
  return text.str();
}

}  // namespace flockstep
