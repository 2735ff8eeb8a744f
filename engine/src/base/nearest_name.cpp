#include "base/nearest_name.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

namespace flockstep {
namespace {

struct Match {
  std::size_t in_a, in_b, length;
};

// Finds the longest common substring. On ties, the first one in a wins, then the first one in b.
Match longest_match(std::string_view a, std::string_view b) {
  Match best{0, 0, 0};
  std::vector<std::size_t> lengths(b.size() + 1), next(b.size() + 1);  // lengths of matches that end before b[j]
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t length = next[j + 1] = a[i] == b[j] ? lengths[j] + 1 : 0;
      if (length > best.length) best = {i + 1 - length, j + 1 - length, length};
    }
    lengths.swap(next);
  }
  return best;
}

std::size_t matched(std::string_view a, std::string_view b) {
  const Match match = longest_match(a, b);
  if (match.length == 0) return 0;
  return match.length + matched(a.substr(0, match.in_a), b.substr(0, match.in_b)) +
         matched(a.substr(match.in_a + match.length), b.substr(match.in_b + match.length));
}

constexpr std::size_t kLongest = 100;  // bytes of a name that is compared
constexpr double kSimilar = 0.6;

std::string_view last_part(std::string_view path) { return path.substr(path.rfind('/') + 1); }

// Returns true for lr and learning_rate.
bool are_initials(std::string_view letters, std::string_view words) {
  if (letters.size() < 2) return false;
  for (const char letter : letters) {
    if (words.empty() || words.front() != letter) return false;
    words = words.substr(std::min(words.find('_'), words.size() - 1) + 1);
  }
  return words.empty();
}

// The similarity of a name to a known one, or to the last part of a known path.
double path_similarity(std::string_view known, std::string_view name) {
  const double whole = are_initials(name, known) ? kSimilar : name_similarity(known, name);
  if (known.find('/') == std::string_view::npos) return whole;
  return std::max(whole, name_similarity(last_part(known), last_part(name)));
}

// Public names that were renamed, with the present ones: a message suggests these, however little they resemble the former.
constexpr std::array<std::pair<std::string_view, std::string_view>, 8> kRenamed{{{"meet", "interaction"},
                                                                                 {"never", "none"},
                                                                                 {"seen", "sense"},
                                                                                 {"touched", "collide"},
                                                                                 {"resting", "finished"},
                                                                                 {"LightSettings", "flockstep.Light"},
                                                                                 {"Mounting", "ServerInfo.imu_configs"},
                                                                                 {"imu_mountings", "imu_configs"}}};

}  // namespace

double name_similarity(std::string_view a, std::string_view b) {
  const std::size_t both = a.size() + b.size();
  return both == 0 ? 1.0 : 2.0 * static_cast<double>(matched(a, b)) / static_cast<double>(both);
}

std::span<const std::pair<std::string_view, std::string_view>> renamed() { return kRenamed; }

std::string_view nearest_name(std::string_view name, std::span<const std::string_view> known) {
  for (const auto& [former, present] : kRenamed) {
    if (former != name) continue;
    if (const auto found = std::ranges::find(known, present); found != known.end()) return *found;
  }
  std::string_view nearest;
  double most = kSimilar;
  if (name.size() > kLongest) return nearest;
  for (const std::string_view candidate : known) {
    const double similarity = path_similarity(candidate, name);
    if (similarity > most || (similarity == most && candidate > nearest)) {
      most = similarity;
      nearest = candidate;
    }
  }
  return nearest;
}

std::vector<std::string_view> nearest_names(std::string_view name, std::span<const std::string_view> known, std::size_t most) {
  std::vector<std::pair<double, std::string_view>> similar;
  for (const std::string_view candidate : known) {
    const double similarity = name.size() > kLongest ? 0.0 : path_similarity(candidate, name);
    if (similarity >= kSimilar) similar.emplace_back(-similarity, candidate);
  }
  std::ranges::sort(similar);
  std::vector<std::string_view> names;
  for (std::size_t i = 0; i < std::min(most, similar.size()); ++i) names.push_back(similar[i].second);
  return names;
}

std::string did_you_mean(std::string_view name, std::span<const std::string_view> known) {
  const std::string_view nearest = nearest_name(name, known);
  return nearest.empty() ? std::string() : ". Did you mean " + std::string(nearest) + '?';
}

}  // namespace flockstep
