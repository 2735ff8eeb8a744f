// Recorded: numbers that keep how they were computed, so that derivatives can be found backwards ("reverse-mode automatic
// differentiation"). They have the operations of Wide; a formula that is a template over its number type computes with both.
// A limit such as min() has the derivative of the side that it chose. Included once per SIMD target.
#if defined(FLOCKSTEP_BASE_RECORDED_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef FLOCKSTEP_BASE_RECORDED_INL_HPP
#undef FLOCKSTEP_BASE_RECORDED_INL_HPP
#else
#define FLOCKSTEP_BASE_RECORDED_INL_HPP
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "base/tape_memory.hpp"
#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::HWY_NAMESPACE {

// The operations since the last clear(): for each result its one or two operands and the derivatives by them.
template <class W>
class Tape {
 public:
  using T = typename W::T;
  using Id = std::uint32_t;
  static constexpr Id kNone = 0;  // of a constant; what flows back to it is not used

  explicit Tape(TapeMemory<T>& memory) : memory_(memory), capacity_(static_cast<Id>(memory.operands.size())) {}

  void clear() { count_ = 1; }

  HWY_INLINE Id add(Id a, W by_a, Id b, W by_b) {
    if (HWY_UNLIKELY(count_ >= capacity_)) grow();
    T* const to = memory_.partials.data() + std::size_t{2 * W::kCount} * count_;
    by_a.store(to);
    by_b.store(to + W::kCount);
    memory_.operands[count_] = {a, b};
    return count_++;
  }
  HWY_INLINE Id add(Id a, W by_a) { return add(a, by_a, kNone, W(T(0))); }

  // Sets all derivatives of the result to 0; then those of the results are added, and they flow back.
  void begin() {
    AlignedVector<T>& derivatives = memory_.derivatives;
    derivatives.resize(std::max(derivatives.size(), W::kCount * count_));
    std::fill_n(derivatives.begin(), W::kCount * count_, T(0));
  }
  HWY_INLINE void add_derivative(Id id, W value) { (derivative(id) + value).store(at(id)); }
  HWY_INLINE W derivative(Id id) const { return W::load(memory_.derivatives.data() + W::kCount * id); }
  void flow_back() {
    for (Id id = count_; id-- > 1;) {
      const W d = derivative(id);
      const auto [a, b] = memory_.operands[id];
      const T* const by = memory_.partials.data() + std::size_t{2 * W::kCount} * id;
      mul_add(d, W::load(by), derivative(a)).store(at(a));
      if (b != kNone) mul_add(d, W::load(by + W::kCount), derivative(b)).store(at(b));
    }
  }

 private:
  void grow() {
    capacity_ = std::max<Id>(2 * capacity_, 1024);
    memory_.partials.resize(std::size_t{2 * W::kCount} * capacity_);
    memory_.operands.resize(capacity_);
  }
  HWY_INLINE T* at(Id id) { return memory_.derivatives.data() + W::kCount * id; }

  TapeMemory<T>& memory_;
  Id count_ = 1, capacity_;
};

// Operations are calls: inlined into a formula, each of them would be a hundred instructions.
template <class W>
struct Recorded {
  using Value = W;
  using T = typename W::T;
  using Mask = typename W::Mask;
  static constexpr std::size_t kCount = W::kCount;

  W value;
  Tape<W>* tape;  // null: a constant
  std::uint32_t id;

  Recorded() = default;
  HWY_INLINE Recorded(W constant) : value(constant), tape(nullptr), id(0) {}  // implicit, so that constants can be operands
  HWY_INLINE Recorded(T constant) : Recorded(W(constant)) {}
  HWY_INLINE Recorded(W value_, Tape<W>* tape_, std::uint32_t id_) : value(value_), tape(tape_), id(id_) {}
  // A number by which derivatives are wanted.
  static HWY_INLINE Recorded input(W value, Tape<W>& tape) { return {value, &tape, tape.add(0, W(T(0)))}; }

  // The result of an operation on one or two numbers.
  static HWY_INLINE Recorded of(W value, const Recorded& a, W by_a) {
    return a.tape == nullptr ? Recorded(value) : Recorded(value, a.tape, a.tape->add(a.id, by_a));
  }
  static HWY_INLINE Recorded of(W value, const Recorded& a, W by_a, const Recorded& b, W by_b) {
    if (b.tape == nullptr) return of(value, a, by_a);
    if (a.tape == nullptr) return of(value, b, by_b);
    return Recorded(value, a.tape, a.tape->add(a.id, by_a, b.id, by_b));
  }

  friend HWY_NOINLINE Recorded operator+(const Recorded& a, const Recorded& b) { return of(a.value + b.value, a, T(1), b, T(1)); }
  friend HWY_NOINLINE Recorded operator-(const Recorded& a, const Recorded& b) {
    return of(a.value - b.value, a, T(1), b, T(-1));
  }
  friend HWY_NOINLINE Recorded operator*(const Recorded& a, const Recorded& b) {
    return of(a.value * b.value, a, b.value, b, a.value);
  }
  friend HWY_NOINLINE Recorded operator/(const Recorded& a, const Recorded& b) {
    const W by_a = T(1) / b.value, quotient = a.value / b.value;
    return of(quotient, a, by_a, b, -(quotient * by_a));
  }
  friend HWY_NOINLINE Recorded operator-(const Recorded& a) { return of(-a.value, a, T(-1)); }
  friend HWY_NOINLINE Recorded min(const Recorded& a, const Recorded& b) {
    return of(min(a.value, b.value), a, value_if(a.value <= b.value, W(T(1))), b, zero_if(a.value <= b.value, W(T(1))));
  }
  friend HWY_NOINLINE Recorded max(const Recorded& a, const Recorded& b) {
    return of(max(a.value, b.value), a, value_if(a.value >= b.value, W(T(1))), b, zero_if(a.value >= b.value, W(T(1))));
  }
  friend HWY_NOINLINE Recorded abs(const Recorded& a) { return of(abs(a.value), a, copy_sign(W(T(1)), a.value)); }
  // At 0, where it is infinite, the derivative is 0.
  friend HWY_NOINLINE Recorded sqrt(const Recorded& a) {
    const W root = sqrt(a.value);
    return of(root, a, value_if(root > T(0), T(0.5) / root));
  }
  friend HWY_NOINLINE Recorded select(Mask mask, const Recorded& yes, const Recorded& no) {
    return of(select(mask, yes.value, no.value), yes, value_if(mask, W(T(1))), no, zero_if(mask, W(T(1))));
  }
  // The value of `a` replaced, with the same derivative.
  friend HWY_NOINLINE Recorded with_value(const Recorded& a, W value) { return of(value, a, T(1)); }

#define FLOCKSTEP_COMPARISON(op) \
  friend HWY_INLINE Mask operator op(const Recorded& a, const Recorded& b) { return a.value op b.value; }
  FLOCKSTEP_COMPARISON(<)
  FLOCKSTEP_COMPARISON(<=)
  FLOCKSTEP_COMPARISON(>)
  FLOCKSTEP_COMPARISON(>=)
#undef FLOCKSTEP_COMPARISON
};

}  // namespace flockstep::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
