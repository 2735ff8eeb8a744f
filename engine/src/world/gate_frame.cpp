#include "world/gate_frame.hpp"

#include <algorithm>
#include <array>
#include <cstddef>

namespace flockstep {
namespace {

using Vec3d = Eigen::Vector3d;
using Quatd = Eigen::Quaterniond;

// Cosines of k pi / 16 for k = 0 to 8. The functions of the C library may differ in the last bit between machines.
constexpr std::array<double, 9> kCosines{1.0,
                                         0.98078528040323044913,
                                         0.92387953251128675613,
                                         0.83146961230254523708,
                                         0.70710678118654752440,
                                         0.55557023301960222474,
                                         0.38268343236508977173,
                                         0.19509032201612826785,
                                         0.0};
static_assert(kRingBars == 16);

// Cosine and sine of k pi / 16 for k = 0 to 31.
double cosine(std::size_t k) {
  k = std::min(k, 32 - k);
  return k <= 8 ? kCosines[k] : -kCosines[16 - k];
}
double sine(std::size_t k) { return cosine((k + 24) % 32); }

class FrameBars {
 public:
  FrameBars(const Gate& gate, std::vector<Primitive>& bars)
      : gate_(gate), turn_(gate.rotation.cast<double>()), bars_(bars), inside_(gate.size / 2.0), half_bar_(gate.bar / 2.0) {}

  // The bars above and below reach over the ends of those at the sides.
  void add_square() {
    const double away = inside_ + half_bar_;
    for (const double side : {-away, away}) {
      add(PrimitiveKind::box, {0.0, 0.0, side}, Quatd::Identity(), {half_bar_, inside_ + 2.0 * half_bar_, half_bar_});
      add(PrimitiveKind::box, {0.0, side, 0.0}, Quatd::Identity(), {half_bar_, half_bar_, inside_});
    }
  }

  // A regular polygon. The middles of its bars are closest to the centre and touch the opening.
  void add_ring() {
    const double away = inside_ + half_bar_;
    const double half_length = away * sine(1) / cosine(1);
    for (std::size_t i = 0; i < kRingBars; ++i) {
      const Quatd along(cosine(i), sine(i), 0.0, 0.0);  // turns z by i / 16 of a turn about x
      add(PrimitiveKind::capsule, {0.0, away * cosine(2 * i), away * sine(2 * i)}, along,
          {half_bar_, half_bar_, half_length + half_bar_});
    }
  }

 private:
  void add(PrimitiveKind kind, const Vec3d& center, const Quatd& rotation, const Vec3d& half) {
    bars_.push_back({.kind = kind,
                     .center = (gate_.center.cast<double>() + turn_ * center).cast<float>(),
                     .rotation = (turn_ * rotation).normalized().cast<float>(),
                     .half_extents = half.cast<float>(),
                     .material = gate_.material,
                     .visibility = gate_.visibility});
  }

  const Gate& gate_;
  Quatd turn_;
  std::vector<Primitive>& bars_;
  double inside_, half_bar_;  // m
};

}  // namespace

void append_frame(const Gate& gate, std::vector<Primitive>& bars) {
  FrameBars frame(gate, bars);
  if (gate.shape == GateShape::ring) {
    frame.add_ring();
  } else {
    frame.add_square();
  }
}

std::vector<Primitive> with_frames(const SceneDescription& description) {
  if (description.gates.empty()) return {};
  std::vector<Primitive> all = description.primitives;
  for (const Gate& gate : description.gates) append_frame(gate, all);
  std::ranges::stable_sort(all, {}, &Primitive::kind);
  return all;
}

}  // namespace flockstep
