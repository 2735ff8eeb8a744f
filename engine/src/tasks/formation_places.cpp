#include <algorithm>
#include <cmath>
#include <numbers>

#include "flockstep/tasks/formation.hpp"

namespace flockstep {

std::vector<Vec3> formation_places(FormationShape shape, std::size_t count, float spacing_m) {
  constexpr float kTurn = 2.0F * std::numbers::pi_v<float>;
  const auto number = static_cast<float>(count);
  const float radius = count < 2 ? spacing_m : std::max(spacing_m, spacing_m / (2.0F * std::sin(kTurn / 2.0F / number)));
  std::vector<Vec3> places;
  places.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const float pair = spacing_m * static_cast<float>(i / 2 + 1), side = i % 2 == 0 ? 1.0F : -1.0F;
    const float slant = pair / std::numbers::sqrt2_v<float>, angle = kTurn * static_cast<float>(i) / number;
    switch (shape) {
      case FormationShape::line:
        places.emplace_back(0.0F, side * pair, 0.0F);
        break;
      case FormationShape::column:
        places.emplace_back(-spacing_m * static_cast<float>(i + 1), 0.0F, 0.0F);
        break;
      case FormationShape::v:
        places.emplace_back(-slant, side * slant, 0.0F);
        break;
      case FormationShape::circle:
        places.emplace_back(radius * std::cos(angle), radius * std::sin(angle), 0.0F);
        break;
    }
  }
  return places;
}

}  // namespace flockstep
