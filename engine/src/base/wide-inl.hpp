// SIMD types: Wide (floats or integers), WideMask (a mask of lanes) and Wide3 (vectors of three). Formulas look the same as for
// single numbers, and a scalar operand applies to every lane. Included once per SIMD target (by Highway's foreach_target).
//
// Every operation is correctly rounded and none are contracted, so each lane has the same bits on every target. mul_add() and
// neg_mul_add() are the exceptions: they round once on targets with fused operations, and twice on others.
//
// GCC compiles implicit constructors for the baseline target, so members of these types have no default initialisers.
#if defined(FLOCKSTEP_BASE_WIDE_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef FLOCKSTEP_BASE_WIDE_INL_HPP
#undef FLOCKSTEP_BASE_WIDE_INL_HPP
#else
#define FLOCKSTEP_BASE_WIDE_INL_HPP
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <type_traits>

HWY_BEFORE_NAMESPACE();
namespace flockstep::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// The vectors of a value. The case of one vector is special, because GCC copies an array of one through memory.
template <class V, std::size_t kCount>
struct Parts {
  V parts[kCount];
  HWY_INLINE V& operator[](std::size_t i) { return parts[i]; }
  HWY_INLINE const V& operator[](std::size_t i) const { return parts[i]; }
};
template <class V>
struct Parts<V, 1> {
  V only;
  HWY_INLINE V& operator[](std::size_t) { return only; }
  HWY_INLINE const V& operator[](std::size_t) const { return only; }
};

// Computes each part without a loop; in a loop, GCC would keep the parts in memory.
#define FLOCKSTEP_PART(number, expression) \
  if constexpr (number < kParts) {         \
    constexpr std::size_t p = number;      \
    result.part[p] = expression;           \
  }
#define FLOCKSTEP_EACH_PART(Result, expression) \
  Result result;                                \
  static_assert(Result::kParts <= 8);           \
  FLOCKSTEP_PART(0, expression)                 \
  FLOCKSTEP_PART(1, expression)                 \
  FLOCKSTEP_PART(2, expression)                 \
  FLOCKSTEP_PART(3, expression)                 \
  FLOCKSTEP_PART(4, expression)                 \
  FLOCKSTEP_PART(5, expression)                 \
  FLOCKSTEP_PART(6, expression)                 \
  FLOCKSTEP_PART(7, expression)                 \
  return result

// A mask of lanes. D: Highway's tag of signed integers, also for masks of floats of that size.
template <class D, std::size_t kParts_>
struct WideMask {
  static constexpr std::size_t kParts = kParts_, kLanes = hn::MaxLanes(D());
  Parts<hn::Mask<D>, kParts> part;

  WideMask() = default;
  HWY_INLINE explicit WideMask(bool all) {
    for (std::size_t p = 0; p < kParts; ++p) part[p] = hn::Eq(hn::Set(D(), all ? 0 : 1), hn::Zero(D()));
  }

  friend HWY_INLINE WideMask operator&(WideMask a, WideMask b) { FLOCKSTEP_EACH_PART(WideMask, hn::And(a.part[p], b.part[p])); }
  friend HWY_INLINE WideMask operator|(WideMask a, WideMask b) { FLOCKSTEP_EACH_PART(WideMask, hn::Or(a.part[p], b.part[p])); }
  friend HWY_INLINE WideMask operator^(WideMask a, WideMask b) { FLOCKSTEP_EACH_PART(WideMask, hn::Xor(a.part[p], b.part[p])); }
  friend HWY_INLINE WideMask operator~(WideMask a) { FLOCKSTEP_EACH_PART(WideMask, hn::Not(a.part[p])); }
  // a & ~b in one instruction.
  friend HWY_INLINE WideMask without(WideMask a, WideMask b) { FLOCKSTEP_EACH_PART(WideMask, hn::AndNot(b.part[p], a.part[p])); }
  friend HWY_INLINE bool none(WideMask mask) {
    for (std::size_t p = 0; p < kParts; ++p) {
      if (!hn::AllFalse(D(), mask.part[p])) return false;
    }
    return true;
  }
  friend HWY_INLINE bool all(WideMask mask) {
    for (std::size_t p = 0; p < kParts; ++p) {
      if (!hn::AllTrue(D(), mask.part[p])) return false;
    }
    return true;
  }
  // Returns one bit per lane; the first lane is the lowest bit.
  friend HWY_INLINE std::uint32_t bits(WideMask mask) {
    static_assert(kLanes <= 16 && kLanes * kParts <= 32);
    std::uint32_t result = 0;
    for (std::size_t p = 0; p < kParts; ++p) {
      std::conditional_t<kLanes <= 8, std::uint8_t, std::uint16_t> bits = 0;
      hn::StoreMaskBits(D(), mask.part[p], reinterpret_cast<std::uint8_t*>(&bits));
      result |= static_cast<std::uint32_t>(bits) << (p * kLanes);
    }
    return result;
  }
};

// Numbers in kParts vectors of Highway's tag D. Pass them by value: by reference, GCC would keep some in memory.
template <class D, std::size_t kParts_ = 1>
struct Wide {
  using Tag = D;
  using T = hn::TFromD<D>;
  using Int = Wide<hn::RebindToSigned<D>, kParts_>;
  using Mask = WideMask<hn::RebindToSigned<D>, kParts_>;
  static constexpr std::size_t kParts = kParts_, kLanes = hn::MaxLanes(D()), kCount = kParts * kLanes;
  Parts<hn::Vec<D>, kParts> part;

  Wide() = default;
  HWY_INLINE Wide(T x) {  // implicit, so that scalars can be operands
    for (std::size_t p = 0; p < kParts; ++p) part[p] = hn::Set(D(), x);
  }

  static HWY_INLINE Wide load(const T* from) { FLOCKSTEP_EACH_PART(Wide, hn::Load(D(), from + p * kLanes)); }
  static HWY_INLINE Wide load_unaligned(const T* from) { FLOCKSTEP_EACH_PART(Wide, hn::LoadU(D(), from + p * kLanes)); }
  // Loads n numbers, reads no others, and leaves 0 in the other lanes.
  static HWY_INLINE Wide load_first(std::size_t n, const T* from) {
    if (n >= kCount) return load_unaligned(from);
#if HWY_MEM_OPS_MIGHT_FAULT  // MaskedLoad may read the others
    T copy[kCount] = {};
    std::copy_n(from, n, copy);
    return load_unaligned(copy);
#else
    FLOCKSTEP_EACH_PART(Wide, hn::MaskedLoad(hn::FirstN(D(), n > p * kLanes ? n - p * kLanes : 0), D(), from + p * kLanes));
#endif
  }
  static HWY_INLINE Wide gather(const T* table, Int index) {
    FLOCKSTEP_EACH_PART(Wide, hn::GatherIndex(D(), table, index.part[p]));
  }
  // The same for a table of one or two vectors, which is read as a whole. That is much faster. kVectors: 0 for any other table
  template <std::size_t kVectors>
  static HWY_INLINE Wide look_up(const T* table, Int index) {
    static_assert(kVectors <= 2);
    if constexpr (kVectors == 0) return gather(table, index);
    if constexpr (kVectors == 1) return shuffled(table, index);
    constexpr auto kHalf = static_cast<typename Int::T>(kLanes);
    const Int lane = index & (kHalf - 1);
    return select(index < kHalf, shuffled(table, lane), shuffled(table + kLanes, lane));
  }
  // 0, 1, 2, ...
  static HWY_INLINE Wide iota() { FLOCKSTEP_EACH_PART(Wide, hn::Iota(D(), static_cast<T>(p * kLanes))); }
  HWY_INLINE void store(T* to) const {
    for (std::size_t p = 0; p < kParts; ++p) hn::Store(part[p], D(), to + p * kLanes);
  }
  HWY_INLINE void store_unaligned(T* to) const {
    for (std::size_t p = 0; p < kParts; ++p) hn::StoreU(part[p], D(), to + p * kLanes);
  }
  // Stores the first n numbers and writes no others.
  HWY_INLINE void store_first(std::size_t n, T* to) const {
    if (n >= kCount) return store_unaligned(to);
    for (std::size_t p = 0; p < kParts; ++p) {
      hn::BlendedStore(part[p], hn::FirstN(D(), n > p * kLanes ? n - p * kLanes : 0), D(), to + p * kLanes);
    }
  }

  friend HWY_INLINE Wide operator+(Wide a, Wide b) { FLOCKSTEP_EACH_PART(Wide, hn::Add(a.part[p], b.part[p])); }
  friend HWY_INLINE Wide operator-(Wide a, Wide b) { FLOCKSTEP_EACH_PART(Wide, hn::Sub(a.part[p], b.part[p])); }
  friend HWY_INLINE Wide operator*(Wide a, Wide b) { FLOCKSTEP_EACH_PART(Wide, hn::Mul(a.part[p], b.part[p])); }
  friend HWY_INLINE Wide operator/(Wide a, Wide b) { FLOCKSTEP_EACH_PART(Wide, hn::Div(a.part[p], b.part[p])); }
  friend HWY_INLINE Wide operator-(Wide a) { FLOCKSTEP_EACH_PART(Wide, hn::Neg(a.part[p])); }
  // a b + c, and c - a b.
  friend HWY_INLINE Wide mul_add(Wide a, Wide b, Wide c) {
    FLOCKSTEP_EACH_PART(Wide, hn::MulAdd(a.part[p], b.part[p], c.part[p]));
  }
  friend HWY_INLINE Wide neg_mul_add(Wide a, Wide b, Wide c) {
    FLOCKSTEP_EACH_PART(Wide, hn::NegMulAdd(a.part[p], b.part[p], c.part[p]));
  }
  // If the first operand is NaN, the result is the second.
  friend HWY_INLINE Wide min(Wide a, Wide b) { FLOCKSTEP_EACH_PART(Wide, hn::Min(a.part[p], b.part[p])); }
  friend HWY_INLINE Wide max(Wide a, Wide b) { FLOCKSTEP_EACH_PART(Wide, hn::Max(a.part[p], b.part[p])); }
  friend HWY_INLINE Wide abs(Wide a) { FLOCKSTEP_EACH_PART(Wide, hn::Abs(a.part[p])); }
  friend HWY_INLINE Wide sqrt(Wide a) { FLOCKSTEP_EACH_PART(Wide, hn::Sqrt(a.part[p])); }
  friend HWY_INLINE Wide floor(Wide a) { FLOCKSTEP_EACH_PART(Wide, hn::Floor(a.part[p])); }
  friend HWY_INLINE Wide round(Wide a) { FLOCKSTEP_EACH_PART(Wide, hn::Round(a.part[p])); }
  // copy_sign: the magnitude of the first number with the sign of the second. flip_sign: the first number, negated if the
  // second is negative.
  friend HWY_INLINE Wide copy_sign(Wide a, Wide sign) { FLOCKSTEP_EACH_PART(Wide, hn::CopySign(a.part[p], sign.part[p])); }
  friend HWY_INLINE Wide flip_sign(Wide a, Wide sign) {
    FLOCKSTEP_EACH_PART(Wide, hn::Xor(a.part[p], hn::And(sign.part[p], hn::SignBit(D()))));
  }
  // For integers; saturated sums and differences only for small ones.
  friend HWY_INLINE Wide saturated_add(Wide a, Wide b) { FLOCKSTEP_EACH_PART(Wide, hn::SaturatedAdd(a.part[p], b.part[p])); }
  friend HWY_INLINE Wide saturated_sub(Wide a, Wide b) { FLOCKSTEP_EACH_PART(Wide, hn::SaturatedSub(a.part[p], b.part[p])); }
  friend HWY_INLINE Wide operator&(Wide a, Wide b) { FLOCKSTEP_EACH_PART(Wide, hn::And(a.part[p], b.part[p])); }
  friend HWY_INLINE Wide operator|(Wide a, Wide b) { FLOCKSTEP_EACH_PART(Wide, hn::Or(a.part[p], b.part[p])); }
  friend HWY_INLINE Wide operator^(Wide a, Wide b) { FLOCKSTEP_EACH_PART(Wide, hn::Xor(a.part[p], b.part[p])); }

#define FLOCKSTEP_COMPARISON(op, function)                                                    \
  friend HWY_INLINE Mask operator op(Wide a, Wide b) {                                        \
    FLOCKSTEP_EACH_PART(Mask, hn::RebindMask(MaskTag(), hn::function(a.part[p], b.part[p]))); \
  }
  FLOCKSTEP_COMPARISON(==, Eq)
  FLOCKSTEP_COMPARISON(!=, Ne)
  FLOCKSTEP_COMPARISON(<, Lt)
  FLOCKSTEP_COMPARISON(<=, Le)
  FLOCKSTEP_COMPARISON(>, Gt)
  FLOCKSTEP_COMPARISON(>=, Ge)
#undef FLOCKSTEP_COMPARISON

  friend HWY_INLINE Wide select(Mask mask, Wide yes, Wide no) {
    FLOCKSTEP_EACH_PART(Wide, hn::IfThenElse(hn::RebindMask(D(), mask.part[p]), yes.part[p], no.part[p]));
  }
  // The other lanes are 0.
  friend HWY_INLINE Wide value_if(Mask mask, Wide a) {
    FLOCKSTEP_EACH_PART(Wide, hn::IfThenElseZero(hn::RebindMask(D(), mask.part[p]), a.part[p]));
  }
  friend HWY_INLINE Wide zero_if(Mask mask, Wide a) {
    FLOCKSTEP_EACH_PART(Wide, hn::IfThenZeroElse(hn::RebindMask(D(), mask.part[p]), a.part[p]));
  }

  friend HWY_INLINE T min_of_lanes(Wide a) {
    hn::Vec<D> least = a.part[0];
    for (std::size_t p = 1; p < kParts; ++p) least = hn::Min(least, a.part[p]);
    return hn::GetLane(hn::MinOfLanes(D(), least));
  }

 private:
  using MaskTag = hn::RebindToSigned<D>;

  static HWY_INLINE Wide shuffled(const T* lanes, Int lane) {
    FLOCKSTEP_EACH_PART(Wide, hn::TableLookupLanes(hn::LoadU(D(), lanes), hn::IndicesFromVec(D(), lane.part[p])));
  }
};

// One vector of floats, with the target's width but at most kMax lanes. A loop over an array advances by kCount.
template <std::size_t kMax>
using WideUpTo = Wide<hn::CappedTag<float, kMax>>;
// Exactly kCount floats (a power of two), in as many vectors as needed.
template <std::size_t kCount>
using WideOf = Wide<hn::CappedTag<float, kCount>, kCount / hn::MaxLanes(hn::CappedTag<float, kCount>())>;

// Converts floats to integers, rounded towards 0, and back; also to numbers of another size, with the same number of lanes.
template <class To, class D, std::size_t kParts>
HWY_INLINE To convert(Wide<D, kParts> a) {
  static_assert(To::kParts == kParts && To::kLanes == Wide<D, kParts>::kLanes);
  constexpr typename To::Tag to;
  if constexpr (sizeof(typename To::T) == sizeof(hn::TFromD<D>)) {
    FLOCKSTEP_EACH_PART(To, hn::ConvertTo(to, a.part[p]));
  } else if constexpr (sizeof(typename To::T) > sizeof(hn::TFromD<D>)) {
    FLOCKSTEP_EACH_PART(To, hn::PromoteTo(to, a.part[p]));
  } else {
    FLOCKSTEP_EACH_PART(To, hn::DemoteTo(to, a.part[p]));
  }
}
// Keeps the lower bits of integers.
template <class To, class D, std::size_t kParts>
HWY_INLINE To truncate(Wide<D, kParts> a) {
  static_assert(To::kParts == kParts && To::kLanes == Wide<D, kParts>::kLanes);
  FLOCKSTEP_EACH_PART(To, hn::TruncateTo(typename To::Tag(), hn::BitCast(hn::RebindToUnsigned<D>(), a.part[p])));
}
template <class To, class D, std::size_t kParts>
HWY_INLINE To bit_cast(Wide<D, kParts> a) {
  static_assert(To::kParts == kParts && To::kLanes == Wide<D, kParts>::kLanes);
  FLOCKSTEP_EACH_PART(To, hn::BitCast(typename To::Tag(), a.part[p]));
}
template <int kBits, class D, std::size_t kParts, class Result = Wide<D, kParts>>
HWY_INLINE Result shift_left(Wide<D, kParts> a) {
  FLOCKSTEP_EACH_PART(Result, hn::ShiftLeft<kBits>(a.part[p]));
}
template <int kBits, class D, std::size_t kParts, class Result = Wide<D, kParts>>
HWY_INLINE Result shift_right(Wide<D, kParts> a) {
  FLOCKSTEP_EACH_PART(Result, hn::ShiftRight<kBits>(a.part[p]));
}
#undef FLOCKSTEP_EACH_PART
#undef FLOCKSTEP_PART

// A vector of three Wide values of type F.
template <class F>
struct Wide3 {
  F x, y, z;

  static HWY_INLINE Wide3 load(const typename F::T* x, const typename F::T* y, const typename F::T* z) {
    return {F::load(x), F::load(y), F::load(z)};
  }
  static HWY_INLINE Wide3 load_unaligned(const typename F::T* x, const typename F::T* y, const typename F::T* z) {
    return {F::load_unaligned(x), F::load_unaligned(y), F::load_unaligned(z)};
  }
  HWY_INLINE void store(typename F::T* to_x, typename F::T* to_y, typename F::T* to_z) const {
    x.store(to_x);
    y.store(to_y);
    z.store(to_z);
  }

  // The rows are contiguous: x, y, z, x, y, z, ...
  static HWY_INLINE Wide3 load_rows(const typename F::T* rows) {
    Wide3 v;
    for (std::size_t p = 0; p < F::kParts; ++p) {
      hn::LoadInterleaved3(typename F::Tag(), rows + 3 * p * F::kLanes, v.x.part[p], v.y.part[p], v.z.part[p]);
    }
    return v;
  }
  // Loads n rows, reads no others, and leaves 0 in the other lanes.
  static HWY_INLINE Wide3 load_first_rows(std::size_t n, const typename F::T* rows) {
    if (n >= F::kCount) return load_rows(rows);
    typename F::T copy[3 * F::kCount];
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t first = k * F::kCount;
      F::load_first(3 * n > first ? 3 * n - first : 0, rows + first).store_unaligned(copy + first);
    }
    return load_rows(copy);
  }
  HWY_INLINE void store_rows(typename F::T* rows) const {
    for (std::size_t p = 0; p < F::kParts; ++p) {
      hn::StoreInterleaved3(x.part[p], y.part[p], z.part[p], typename F::Tag(), rows + 3 * p * F::kLanes);
    }
  }

  friend HWY_INLINE Wide3 operator+(const Wide3& a, const Wide3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend HWY_INLINE Wide3 operator-(const Wide3& a, const Wide3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend HWY_INLINE Wide3 operator-(const Wide3& a) { return {-a.x, -a.y, -a.z}; }
  friend HWY_INLINE Wide3 operator*(const Wide3& a, F s) { return {a.x * s, a.y * s, a.z * s}; }
  friend HWY_INLINE Wide3 operator/(const Wide3& a, F s) { return {a.x / s, a.y / s, a.z / s}; }
  friend HWY_INLINE F dot(const Wide3& a, const Wide3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
  friend HWY_INLINE Wide3 cross(const Wide3& a, const Wide3& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
  }
  friend HWY_INLINE Wide3 select(const typename F::Mask& mask, const Wide3& yes, const Wide3& no) {
    return {select(mask, yes.x, no.x), select(mask, yes.y, no.y), select(mask, yes.z, no.z)};
  }
};

// Returns m v. m: a matrix, read as m(row, column).
template <class Matrix, class F>
HWY_INLINE Wide3<F> rotate(const Matrix& m, const Wide3<F>& v) {
  const auto row = [&](int i) HWY_ATTR { return F(m(i, 0)) * v.x + F(m(i, 1)) * v.y + F(m(i, 2)) * v.z; };
  return {row(0), row(1), row(2)};
}

}  // namespace flockstep::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
