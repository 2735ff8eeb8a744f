// Timing for the C++ benchmarks. Variants of a job run in turns, so that drifting machine speed affects all of them equally.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

namespace bench {

struct Variant {
  std::string label;
  std::function<void()> run;
};

using Times = std::vector<std::vector<double>>;  // s, indexed [variant][run]

inline double seconds(const std::function<void()>& run) {
  const auto start = std::chrono::steady_clock::now();
  run();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Runs each variant once as a warm-up, then `runs` rounds of all variants. A measurement repeats its job until it takes at
// least min_seconds.
inline Times interleave(const std::vector<Variant>& variants, int runs, double min_seconds = 0.03) {
  std::vector<int> repeats;
  for (const Variant& variant : variants) {
    variant.run();
    repeats.push_back(1 + static_cast<int>(min_seconds / seconds(variant.run)));
  }
  Times times(variants.size());
  for (int round = 0; round < runs; ++round) {
    for (std::size_t v = 0; v < variants.size(); ++v) {
      const double total = seconds([&] {
        for (int i = 0; i < repeats[v]; ++i) variants[v].run();
      });
      times[v].push_back(total / repeats[v]);
    }
  }
  return times;
}

inline double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

// Returns the variant with the least median time, from `first` to before `end`.
inline std::size_t fastest(const Times& times, std::size_t first, std::size_t end) {
  std::size_t best = first;
  for (std::size_t v = first; v < end; ++v) {
    if (median(times[v]) < median(times[best])) best = v;
  }
  return best;
}

// Prints the rate of each variant, for a person who watches. count: items of a run.
inline void print_rates(const std::string& name, const std::vector<Variant>& variants, const Times& times, double count,
                        const char* unit) {
  for (std::size_t v = 0; v < variants.size(); ++v) {
    std::fprintf(stderr, "  %-34s %-28s %12.1f %s\n", name.c_str(), variants[v].label.c_str(), count / median(times[v]), unit);
  }
}

// Returns a / b of each round.
inline std::vector<double> ratios(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> found;
  for (std::size_t i = 0; i < a.size(); ++i) found.push_back(a[i] / b[i]);
  return found;
}

inline double median_ratio(const std::vector<double>& a, const std::vector<double>& b) { return median(ratios(a, b)); }

// Returns count / time of each round.
inline std::vector<double> rates(const std::vector<double>& times, double count) {
  std::vector<double> found;
  for (const double time : times) found.push_back(count / time);
  return found;
}

class Figures {
 public:
  void add(const std::string& name, double value, const std::string& unit, int runs, const std::string& more = "") {
    char line[512];
    std::snprintf(line, sizeof(line), R"({"name": "%s", "value": %.6g, "unit": "%s", "runs": %d%s})", name.c_str(), value,
                  unit.c_str(), runs, more.c_str());
    lines_.emplace_back(line);
  }
  // Adds the median of some runs, with the least and the greatest.
  void add(const std::string& name, const std::vector<double>& values, const std::string& unit) {
    const auto [least, greatest] = std::minmax_element(values.begin(), values.end());
    char more[96];
    std::snprintf(more, sizeof(more), R"(, "least": %.6g, "greatest": %.6g)", *least, *greatest);
    add(name, median(values), unit, static_cast<int>(values.size()), more);
  }
  void print() const {
    std::printf("[\n");
    for (std::size_t i = 0; i < lines_.size(); ++i) std::printf("  %s%s\n", lines_[i].c_str(), i + 1 < lines_.size() ? "," : "");
    std::printf("]\n");
  }

 private:
  std::vector<std::string> lines_;
};

}  // namespace bench
