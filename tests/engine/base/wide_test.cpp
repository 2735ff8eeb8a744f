// Each lane of a wide number has the same bits as the scalar operation.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "base/wide_test.cpp"
#include <hwy/foreach_target.h>
// Highway's headers must come after foreach_target.
#include <hwy/highway.h>

#include <bit>

#include "base/wide-inl.hpp"
#include "on_target.hpp"
#include "standard.hpp"

#ifndef FLOCKSTEP_WIDE_TEST_COMMON
#define FLOCKSTEP_WIDE_TEST_COMMON
namespace flockstep::wide_test {

constexpr std::size_t kLanes = 16, kFloats = 24, kInts = 12, kMasks = 14;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
using Floats = std::array<float, kLanes>;
using Ints = std::array<std::int32_t, kLanes>;

struct alignas(64) Inputs {
  Floats a, b, c;
  Ints i, j;
};
struct alignas(64) Outputs {
  std::array<Floats, kFloats> floats{};
  std::array<Ints, kInts> ints{};
  std::array<std::uint32_t, kMasks> masks{};
  float least = 0.0F;
  std::array<float, 3 * kLanes> rows{};
};

}  // namespace flockstep::wide_test
#endif

HWY_BEFORE_NAMESPACE();
namespace flockstep::wide_test::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // for the wide type

// Computes the results for sixteen lanes in steps of F. The lanes fit one vector, one number of several vectors, or several
// numbers.
template <class F>
HWY_INLINE void compute(const Inputs& in, Outputs& out) {
  using I = typename F::Int;
  using M = typename F::Mask;
  for (std::size_t at = 0; at < kLanes; at += F::kCount) {
    const F a = F::load(in.a.data() + at), b = F::load(in.b.data() + at), c = F::load_unaligned(in.c.data() + at);
    const I i = I::load(in.i.data() + at), j = I::load(in.j.data() + at);
    const Wide3<F> v{a, b, c}, w{c, a, 2.0F};
    const auto m = [](int row, int column) { return static_cast<float>(3 * row + column) / 7.0F; };
    const Wide3<F> x = cross(v, w), y = rotate(m, v), z = select(a < b, v + w, -(v - w) / 3.0F);
    const F floats[kFloats] = {a + b,
                               a - b,
                               a * b,
                               a / b,
                               -a,
                               min(a, b),
                               max(a, b),
                               abs(a),
                               sqrt(abs(a)),
                               floor(a),
                               round(a),
                               copy_sign(a, b),
                               flip_sign(a, b),
                               dot(v, w),
                               x.x,
                               x.y,
                               x.z,
                               y.z,
                               z.x,
                               1.0F - a * 0.5F,
                               convert<F>(i),
                               bit_cast<F>(i),
                               min(F(kNan), b),
                               max(F(kNan), b)};
    for (std::size_t k = 0; k < kFloats; ++k) floats[k].store(out.floats[k].data() + at);
    const M less = a < b, even = (i & 1) == 0;
    const I ints[kInts] = {I::iota() + static_cast<std::int32_t>(at),
                           i + j,
                           i - j,
                           i & j,
                           i | j,
                           i ^ j,
                           shift_left<3>(i),
                           shift_right<5>(i),
                           convert<I>(a),
                           bit_cast<I>(a),
                           select(less, i, j),
                           I::gather(in.j.data(), i & 15)};
    for (std::size_t k = 0; k < kInts; ++k) ints[k].store_unaligned(out.ints[k].data() + at);
    const M masks[kMasks] = {a == b,
                             a != b,
                             less,
                             a <= b,
                             a > b,
                             a >= b,
                             i<j, i>
                                 j,
                             less & even,
                             less | even,
                             ~less & M(true),
                             without(less, even),
                             M(false),
                             value_if(even, I(1)) != zero_if(even, I(1))};
    for (std::size_t k = 0; k < kMasks; ++k) {
      out.masks[k] |= bits(masks[k]) << at;
      if (none(masks[k]) != (bits(masks[k]) == 0) || all(masks[k]) != (bits(~masks[k]) == 0)) out.masks[k] = ~0U;
    }
    out.least = at == 0 ? min_of_lanes(a) : std::min(out.least, min_of_lanes(a));
    v.store_rows(out.rows.data() + 3 * at);
    const Wide3<F> back = Wide3<F>::load_rows(out.rows.data() + 3 * at);
    if (!all((back.x == v.x) & (back.y == v.y) & (back.z == v.z))) out.rows.fill(0.0F);
  }
}

void compute_in_one_number(const Inputs& in, Outputs& out) { compute<WideOf<kLanes>>(in, out); }
void compute_in_vectors(const Inputs& in, Outputs& out) { compute<WideUpTo<kLanes>>(in, out); }
void compute_in_fours(const Inputs& in, Outputs& out) { compute<WideUpTo<4>>(in, out); }

}  // namespace flockstep::wide_test::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::wide_test {
namespace {

using namespace testing;

HWY_EXPORT(compute_in_one_number);
HWY_EXPORT(compute_in_vectors);
HWY_EXPORT(compute_in_fours);

Outputs expected(const Inputs& in) {
  Outputs out;
  out.least = *std::min_element(in.a.begin(), in.a.end());
  for (std::size_t k = 0; k < kLanes; ++k) {
    const float a = in.a[k], b = in.b[k], c = in.c[k];
    const std::int32_t i = in.i[k], j = in.j[k];
    const float product = a * c, other = b * a, third = c * 2.0F;
    const float floats[kFloats] = {a + b,
                                   a - b,
                                   a * b,
                                   a / b,
                                   -a,
                                   std::min(a, b),
                                   std::max(a, b),
                                   std::abs(a),
                                   std::sqrt(std::abs(a)),
                                   std::floor(a),
                                   std::nearbyint(a),
                                   std::copysign(a, b),
                                   std::signbit(b) ? -a : a,
                                   product + other + third,
                                   b * 2.0F - c * a,
                                   c * c - a * 2.0F,
                                   a * a - b * c,
                                   6.0F / 7.0F * a + 7.0F / 7.0F * b + 8.0F / 7.0F * c,
                                   a < b ? a + c : -(a - c) / 3.0F,
                                   1.0F - a * 0.5F,
                                   static_cast<float>(i),
                                   std::bit_cast<float>(i),
                                   b,  // second operand if the first is NaN
                                   b};
    for (std::size_t n = 0; n < kFloats; ++n) out.floats[n][k] = floats[n];
    const std::int32_t ints[kInts] = {static_cast<std::int32_t>(k),
                                      i + j,
                                      i - j,
                                      i & j,
                                      i | j,
                                      i ^ j,
                                      i * 8,
                                      i >> 5,
                                      static_cast<std::int32_t>(a),
                                      std::bit_cast<std::int32_t>(a),
                                      a < b ? i : j,
                                      in.j[static_cast<std::size_t>(i & 15)]};
    for (std::size_t n = 0; n < kInts; ++n) out.ints[n][k] = ints[n];
    const bool less = a < b, even = i % 2 == 0;
    const bool masks[kMasks] = {a == b,       a != b,       less,  a <= b,        a > b, a >= b, i<j, i> j,
                                less && even, less || even, !less, less && !even, false, true};
    for (std::size_t n = 0; n < kMasks; ++n) out.masks[n] |= static_cast<std::uint32_t>(masks[n]) << k;
    std::copy_n(std::array{a, b, c}.begin(), 3, out.rows.begin() + 3 * static_cast<std::ptrdiff_t>(k));
  }
  return out;
}

void expect_equal(const Outputs& got, const Outputs& want) {
  for (std::size_t n = 0; n < kFloats; ++n) {
    for (std::size_t k = 0; k < kLanes; ++k) {
      EXPECT_EQ(std::bit_cast<std::uint32_t>(got.floats[n][k]), std::bit_cast<std::uint32_t>(want.floats[n][k]))
          << "number " << n << ", lane " << k << ": " << got.floats[n][k] << " and not " << want.floats[n][k];
    }
  }
  EXPECT_EQ(got.ints, want.ints);
  EXPECT_EQ(got.masks, want.masks);
  EXPECT_EQ(got.least, want.least);
  EXPECT_EQ(got.rows, want.rows);
}

TEST(Wide, EveryLaneIsAsOneNumberOnEveryTarget) {
  const Inputs in{{1.5F, -2.5F, 3.0F, 1e-30F, -7.25F, 0.1F, 1e7F, -0.0F, 2.5F, -3.5F, 0.3F, 12.0F, -1e-3F, 99.0F, 5.0F, -6.5F},
                  {-1.0F, 2.0F, 3.0F, 7.0F, -8.5F, 0.2F, 3.0F, -4.0F, 1e20F, -3.5F, 0.7F, -0.3F, 1e-3F, -99.0F, 6.0F, 0.5F},
                  {0.1F, 0.2F, 0.3F, 0.4F, 0.5F, 0.6F, 0.7F, 0.8F, 0.9F, 1.1F, 1.2F, 1.3F, 1.4F, 1.5F, 1.6F, 1.7F},
                  {1, -2, 3, 400, 5, -6000, 7, 8, -9, 10, 11000, 12, 13, -14, 15, 16777217},
                  {-1, 2, 3, 4, 50, -7000, 7, -8, 9, 1000, 11, -12, 13, 14, 1 << 20, 0}};
  const Outputs want = expected(in);
  on_every_target([&] {
    Outputs one, vectors, fours;
    HWY_DYNAMIC_DISPATCH(compute_in_one_number)(in, one);
    HWY_DYNAMIC_DISPATCH(compute_in_vectors)(in, vectors);
    HWY_DYNAMIC_DISPATCH(compute_in_fours)(in, fours);
    expect_equal(one, want);
    expect_equal(vectors, want);
    expect_equal(fours, want);
  });
}

}  // namespace
}  // namespace flockstep::wide_test
#endif
