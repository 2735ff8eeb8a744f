// The random numbers of random.hpp in lanes: lane i has the words of the i-th of consecutive draws. Included once per SIMD
// target.
#if defined(FLOCKSTEP_BASE_RANDOM_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef FLOCKSTEP_BASE_RANDOM_INL_HPP
#undef FLOCKSTEP_BASE_RANDOM_INL_HPP
#else
#define FLOCKSTEP_BASE_RANDOM_INL_HPP
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <span>

#include "base/random.hpp"
#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::HWY_NAMESPACE {

// Unsigned integers, as many as the floats of F.
template <class F>
using WordsOf = Wide<hn::RebindToUnsigned<typename F::Tag>>;

// The four words of a draw.
template <class U>
struct Draws {
  U a, b, c, d;
};

// Halves of the products of 32 x 32 bits.
template <class U>
struct Product {
  U high, low;
};
template <class U>
HWY_INLINE Product<U> product_of(U a, U b) {
  static_assert(U::kParts == 1);
  constexpr typename U::Tag tag;
  constexpr hn::RepartitionToWide<typename U::Tag> wide;
  const auto even = hn::MulEven(a.part[0], b.part[0]);
  const auto odd = hn::MulEven(hn::BitCast(tag, hn::ShiftRight<32>(hn::BitCast(wide, a.part[0]))), b.part[0]);
  Product<U> product;
  product.high.part[0] = hn::OddEven(hn::BitCast(tag, odd), hn::BitCast(tag, hn::ShiftRight<32>(even)));
  product.low.part[0] = hn::OddEven(hn::BitCast(tag, hn::ShiftLeft<32>(odd)), hn::BitCast(tag, even));
  return product;
}

// philox4x32() of consecutive draws, the first with this input.
template <class U>
HWY_INLINE Draws<U> philox_draws(const PhiloxInput& first) {
  constexpr int kRounds = 10;
  Draws<U> words{U(first.counter[0]) + U::iota(), U(first.counter[1]), U(first.counter[2]), U(first.counter[3])};
  std::uint32_t key0 = first.key[0], key1 = first.key[1];
  for (int round = 0; round < kRounds; ++round) {
    const Product<U> a = product_of(words.a, U(0xD2511F53U)), b = product_of(words.c, U(0xCD9E8D57U));
    words = {b.high ^ words.b ^ U(key0), b.low, a.high ^ words.d ^ U(key1), a.low};
    key0 += 0x9E3779B9U;
    key1 += 0xBB67AE85U;
  }
  return words;
}

// uniform01().
template <class F>
HWY_INLINE F uniform_of(WordsOf<F> word) {
  return convert<F>(bit_cast<typename F::Int>(shift_right<8>(word))) * 0x1p-24F;
}

// Natural logarithm of positive normal floats over 2^31, to 1e-7 near 1 and of larger results. log(1 + f) is the polynomial of
// S. L. Moshier's Cephes library (logf.c), for f in [sqrt(1/2), sqrt(2)) - 1.
template <class F>
HWY_INLINE F log_of_31_bits(F x) {
  using I = typename F::Int;
  constexpr std::int32_t kRootOfHalf = 0x3F3504F3;
  const I exponent = shift_right<23>(bit_cast<I>(x) - kRootOfHalf);
  const F f = bit_cast<F>(bit_cast<I>(x) - shift_left<23>(exponent)) - 1.0F;
  const F square = f * f;
  F p = 7.0376836292E-2F;
  for (const float next : {-1.1514610310E-1F, 1.1676998740E-1F, -1.2420140846E-1F, 1.4249322787E-1F, -1.6668057665E-1F,
                           2.0000714765E-1F, -2.4999993993E-1F, 3.3333331174E-1F}) {
    p = p * f + next;
  }
  return f - 0.5F * square + square * f * p + convert<F>(exponent - 31) * std::numbers::ln2_v<float>;
}

// Independent standard normal numbers.
template <class F>
struct NormalPair {
  F first, second;
};

// normal_pair() in float32. The first word gives 31 bits, so numbers are within +-6.6.
template <class F>
HWY_INLINE NormalPair<F> normal_pair_of(WordsOf<F> radius_word, WordsOf<F> angle_word) {
  using I = typename F::Int;
  const F radius = sqrt(-2.0F * log_of_31_bits(convert<F>(bit_cast<I>(shift_right<1>(radius_word))) + 1.0F));
  // The angle, in turns of 2^32, is that of the nearest quadrant's axis and a rest within an eighth of a turn.
  const I turn = bit_cast<I>(angle_word);
  const I quadrant = shift_right<30>(turn + (1 << 29));
  const F x = convert<F>(turn - shift_left<30>(quadrant)) * (2.0F * std::numbers::pi_v<float> * 0x1p-32F);
  const F z = x * x;  // the polynomials of Cephes (sinf.c)
  const F sine = x + x * z * (-1.6666654611E-1F + z * (8.3321608736E-3F - z * 1.9515295891E-4F));
  const F cosine = 1.0F - 0.5F * z + z * z * (4.1666645683E-2F + z * (-1.3887316255E-3F + z * 2.4433157118E-5F));
  const auto is_odd = (quadrant & 1) == I(1);
  const F along = flip_sign(select(is_odd, sine, cosine), bit_cast<F>(shift_left<30>(quadrant + 1)));
  const F across = flip_sign(select(is_odd, cosine, sine), bit_cast<F>(shift_left<30>(quadrant)));
  return {radius * along, radius * across};
}

// Fills a list with independent standard normal numbers, four from each of consecutive draws.
template <class F>
HWY_INLINE void write_normals(PhiloxInput draw, std::span<float> list) {
  constexpr std::size_t kNumbers = 4 * F::kCount;  // of a vector of draws
  alignas(64) float numbers[kNumbers];
  for (std::size_t first = 0; first < list.size(); first += kNumbers) {
    const auto words = philox_draws<WordsOf<F>>(draw);
    const NormalPair<F> one = normal_pair_of<F>(words.a, words.b), other = normal_pair_of<F>(words.c, words.d);
    hn::StoreInterleaved4(one.first.part[0], one.second.part[0], other.first.part[0], other.second.part[0], typename F::Tag(),
                          numbers);
    std::copy_n(numbers, std::min(kNumbers, list.size() - first), list.data() + first);
    draw.counter[0] += static_cast<std::uint32_t>(F::kCount);
  }
}

}  // namespace flockstep::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
