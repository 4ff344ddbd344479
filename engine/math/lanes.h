#pragma once
// A lane type holds one number per finger: `Lanes<T, W>` carries W fingers in one SIMD register, and plain
// `double` / `float` is the one-lane case. Kernels are templates over the lane type and use only the functions
// below, so that one text serves the reference and the real-time solver.
//
// The third parameter is the width of the processor's registers in bits. It makes code for a wider processor a type
// of its own, never to be mixed up with code for a plain one, and where it exceeds what W lanes need, the rest of the
// register takes other work of the same fingers.

#include <cmath>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <utility>

#if defined(__AVX__)
#include <immintrin.h>
#endif

namespace palpate {

template <class T>
struct MaskInteger {
    using type = std::conditional_t<sizeof(T) == 8, std::int64_t, std::int32_t>;
};

/// Bits that W lanes of T fill.
template <class T, int W>
inline constexpr int lane_bits = 8 * int(sizeof(T)) * W;

/// Result of comparing lanes: all bits set where true.
template <class T, int W, int Bits = lane_bits<T, W>>
struct LaneMask {
    typedef typename MaskInteger<T>::type Vector __attribute__((vector_size(sizeof(T) * W)));
    Vector bits;

    friend LaneMask operator&(LaneMask a, LaneMask b) { return {a.bits & b.bits}; }
    friend LaneMask operator|(LaneMask a, LaneMask b) { return {a.bits | b.bits}; }
    friend LaneMask operator!(LaneMask a) { return {~a.bits}; }
};

template <class T, int W, int Bits = lane_bits<T, W>>
struct Lanes {
    static_assert(W > 1 && (W & (W - 1)) == 0, "a power of two");
    typedef T Vector __attribute__((vector_size(sizeof(T) * W)));
    using Mask = LaneMask<T, W, Bits>;
    Vector v;

    Lanes() = default;
    template <class S>
    requires std::is_arithmetic_v<S> Lanes(S s) : v(T(s) - Vector{}) {}  // s - 0 is s to the compiler; 0 + s is not
    explicit Lanes(Vector vector) : v(vector) {}

    friend Lanes operator+(Lanes a, Lanes b) { return Lanes(a.v + b.v); }
    friend Lanes operator-(Lanes a, Lanes b) { return Lanes(a.v - b.v); }
    friend Lanes operator*(Lanes a, Lanes b) { return Lanes(a.v * b.v); }
    friend Lanes operator/(Lanes a, Lanes b) { return Lanes(a.v / b.v); }
    friend Lanes operator-(Lanes a) { return Lanes(-a.v); }
    Lanes& operator+=(Lanes b) {
        v += b.v;
        return *this;
    }
    Lanes& operator-=(Lanes b) {
        v -= b.v;
        return *this;
    }
    Lanes& operator*=(Lanes b) {
        v *= b.v;
        return *this;
    }

    friend Mask operator<(Lanes a, Lanes b) { return {a.v < b.v}; }
    friend Mask operator>(Lanes a, Lanes b) { return {a.v > b.v}; }
    friend Mask operator<=(Lanes a, Lanes b) { return {a.v <= b.v}; }
    friend Mask operator>=(Lanes a, Lanes b) { return {a.v >= b.v}; }
};

/// One lane that is not the plain scalar type: it may fill a register with work of its own.
template <class T, int Bits>
struct Lanes<T, 1, Bits> {
    T v;

    Lanes() = default;
    template <class S>
    requires std::is_arithmetic_v<S> Lanes(S s) : v(T(s)) {}

    friend Lanes operator+(Lanes a, Lanes b) { return a.v + b.v; }
    friend Lanes operator-(Lanes a, Lanes b) { return a.v - b.v; }
    friend Lanes operator*(Lanes a, Lanes b) { return a.v * b.v; }
    friend Lanes operator/(Lanes a, Lanes b) { return a.v / b.v; }
    friend Lanes operator-(Lanes a) { return -a.v; }
    Lanes& operator+=(Lanes b) { return *this = *this + b; }
    Lanes& operator-=(Lanes b) { return *this = *this - b; }
    Lanes& operator*=(Lanes b) { return *this = *this * b; }

    friend bool operator<(Lanes a, Lanes b) { return a.v < b.v; }
    friend bool operator>(Lanes a, Lanes b) { return a.v > b.v; }
    friend bool operator<=(Lanes a, Lanes b) { return a.v <= b.v; }
    friend bool operator>=(Lanes a, Lanes b) { return a.v >= b.v; }
};

template <class Real>
struct LaneTraits {
    using Scalar = Real;
    using Mask = bool;
    static constexpr int width = 1;
};
template <class T, int W, int Bits>
struct LaneTraits<Lanes<T, W, Bits>> {
    using Scalar = T;
    using Mask = LaneMask<T, W, Bits>;
    static constexpr int width = W;
};
template <class T, int Bits>
struct LaneTraits<Lanes<T, 1, Bits>> {
    using Scalar = T;
    using Mask = bool;
    static constexpr int width = 1;
};
template <class Real>
using ScalarOf = typename LaneTraits<Real>::Scalar;
template <class Real>
using MaskOf = typename LaneTraits<Real>::Mask;
template <class Real>
inline constexpr int lane_width = LaneTraits<Real>::width;

/// The whole register, where it is wider than the lanes of its fingers; else void.
template <class Real>
struct WholeRegister {
    using type = void;
};
template <class T, int W, int Bits>
struct WholeRegister<Lanes<T, W, Bits>> {
    using type = std::conditional_t<(lane_bits<T, W> < Bits), Lanes<T, Bits / lane_bits<T, 1>, Bits>, void>;
};
/// Whether a register takes several values of the same fingers, each W lanes wide.
template <class Real>
inline constexpr bool shares_register = !std::is_void_v<typename WholeRegister<Real>::type>;

/// Lanes for the rows of one finger's matrices: what a register holds.
template <class Real>
struct RowLanes {
    using type = Lanes<Real, 16 / sizeof(Real)>;  // plain processors
};
template <class T, int Bits>
struct RowLanes<Lanes<T, 1, Bits>> {
    using type = Lanes<T, Bits / lane_bits<T, 1>, Bits>;
};

namespace detail {
/// Bit i is lane i of the mask. The compiler's own code for this takes lane after lane, and solvers ask often.
template <class T, int W, int Bits>
inline unsigned sign_bits(LaneMask<T, W, Bits> m) {
#if defined(__AVX512DQ__)
    if constexpr (sizeof(m.bits) == 64 && sizeof(T) == 4) return _mm512_movepi32_mask((__m512i)m.bits);
    if constexpr (sizeof(m.bits) == 64 && sizeof(T) == 8) return _mm512_movepi64_mask((__m512i)m.bits);
#endif
#if defined(__AVX__)
    if constexpr (sizeof(m.bits) == 32 && sizeof(T) == 4) return unsigned(_mm256_movemask_ps((__m256)m.bits));
    if constexpr (sizeof(m.bits) == 32 && sizeof(T) == 8) return unsigned(_mm256_movemask_pd((__m256d)m.bits));
#endif
    unsigned bits = 0;
    for (int i = 0; i < W; ++i) bits |= m.bits[i] ? 1u << i : 0u;
    return bits;
}
}  // namespace detail

// ---- selection and reduction; a comparison with NaN is false in every lane ----------------------

inline double select(bool m, double a, double b) { return m ? a : b; }
inline float select(bool m, float a, float b) { return m ? a : b; }
template <class T, int Bits>
inline Lanes<T, 1, Bits> select(bool m, Lanes<T, 1, Bits> a, Lanes<T, 1, Bits> b) {
    return m ? a : b;
}
template <class T, int W, int Bits>
inline Lanes<T, W, Bits> select(LaneMask<T, W, Bits> m, Lanes<T, W, Bits> a, Lanes<T, W, Bits> b) {
    return Lanes<T, W, Bits>(m.bits ? a.v : b.v);
}
template <class T, int W, int Bits>
inline Lanes<T, W, Bits> select(LaneMask<T, W, Bits> m, Lanes<T, W, Bits> a, T b) {
    return select(m, a, Lanes<T, W, Bits>(b));
}
template <class T, int W, int Bits>
inline Lanes<T, W, Bits> select(LaneMask<T, W, Bits> m, T a, Lanes<T, W, Bits> b) {
    return select(m, Lanes<T, W, Bits>(a), b);
}

inline bool any(bool m) { return m; }
inline bool all(bool m) { return m; }
template <class T, int W, int Bits>
inline bool any(LaneMask<T, W, Bits> m) {
    return detail::sign_bits(m) != 0;
}
template <class T, int W, int Bits>
inline bool all(LaneMask<T, W, Bits> m) {
    return !any(!m);
}

// ---- arithmetic that the operators do not cover -------------------------------------------------

inline double square_root(double a) { return std::sqrt(a); }
inline float square_root(float a) { return std::sqrt(a); }
template <class T, int Bits>
inline Lanes<T, 1, Bits> square_root(Lanes<T, 1, Bits> a) {
    return std::sqrt(a.v);
}
template <class T, int W, int Bits>
inline Lanes<T, W, Bits> square_root(Lanes<T, W, Bits> a) {
    Lanes<T, W, Bits> r;
    for (int i = 0; i < W; ++i) r.v[i] = std::sqrt(a.v[i]);
    return r;
}

namespace detail {
/// Whether lanes are of a processor that rounds a product and a sum once: all with registers wider than 16 bytes.
template <int Bits>
inline constexpr bool fuses = Bits >= 256;

/// c + a b, rounded once, in each form that the instructions have: the product or c negated.
template <bool minus_product, bool minus_c, class V>
inline V fused(V a, V b, V c) {
#if defined(__FMA__)
    constexpr bool of_float = std::is_same_v<std::decay_t<decltype(a[0])>, float>;
    if constexpr (sizeof(V) == 16 && of_float) {
        if constexpr (minus_product) return V(_mm_fnmadd_ps((__m128)a, (__m128)b, (__m128)c));
        if constexpr (minus_c) return V(_mm_fmsub_ps((__m128)a, (__m128)b, (__m128)c));
        return V(_mm_fmadd_ps((__m128)a, (__m128)b, (__m128)c));
    } else if constexpr (sizeof(V) == 16) {
        if constexpr (minus_product) return V(_mm_fnmadd_pd((__m128d)a, (__m128d)b, (__m128d)c));
        if constexpr (minus_c) return V(_mm_fmsub_pd((__m128d)a, (__m128d)b, (__m128d)c));
        return V(_mm_fmadd_pd((__m128d)a, (__m128d)b, (__m128d)c));
    } else if constexpr (sizeof(V) == 32 && of_float) {
        if constexpr (minus_product) return V(_mm256_fnmadd_ps((__m256)a, (__m256)b, (__m256)c));
        if constexpr (minus_c) return V(_mm256_fmsub_ps((__m256)a, (__m256)b, (__m256)c));
        return V(_mm256_fmadd_ps((__m256)a, (__m256)b, (__m256)c));
    } else if constexpr (sizeof(V) == 32) {
        if constexpr (minus_product) return V(_mm256_fnmadd_pd((__m256d)a, (__m256d)b, (__m256d)c));
        if constexpr (minus_c) return V(_mm256_fmsub_pd((__m256d)a, (__m256d)b, (__m256d)c));
        return V(_mm256_fmadd_pd((__m256d)a, (__m256d)b, (__m256d)c));
    } else {
        static_assert(sizeof(V) == 64);
#if defined(__AVX512F__)
        if constexpr (of_float) {
            if constexpr (minus_product) return V(_mm512_fnmadd_ps((__m512)a, (__m512)b, (__m512)c));
            if constexpr (minus_c) return V(_mm512_fmsub_ps((__m512)a, (__m512)b, (__m512)c));
            return V(_mm512_fmadd_ps((__m512)a, (__m512)b, (__m512)c));
        } else {
            if constexpr (minus_product) return V(_mm512_fnmadd_pd((__m512d)a, (__m512d)b, (__m512d)c));
            if constexpr (minus_c) return V(_mm512_fmsub_pd((__m512d)a, (__m512d)b, (__m512d)c));
            return V(_mm512_fmadd_pd((__m512d)a, (__m512d)b, (__m512d)c));
        }
#endif
    }
#endif
    constexpr std::size_t count = sizeof(V) / sizeof(a[0]);
    for (std::size_t i = 0; i < count; ++i) c[i] = std::fma(minus_product ? -a[i] : a[i], b[i], minus_c ? -c[i] : c[i]);
    return c;
}
}  // namespace detail

/// c + a b, c - a b and a b - c. Lanes of wide registers (AVX2, AVX-512) round them once, all others twice: those of
/// one instruction set give the same bits, however wide they are.
template <class Real>
inline Real plus_product(Real c, Real a, Real b) {
    return c + a * b;
}
template <class Real>
inline Real less_product(Real c, Real a, Real b) {
    return c - a * b;
}
template <class Real>
inline Real product_less(Real a, Real b, Real c) {
    return a * b - c;
}
template <class T, int W, int Bits>
requires(detail::fuses<Bits>) inline Lanes<T, W, Bits> plus_product(Lanes<T, W, Bits> c, Lanes<T, W, Bits> a,
                                                                    Lanes<T, W, Bits> b) {
    if constexpr (W == 1)
        return std::fma(a.v, b.v, c.v);
    else
        return Lanes<T, W, Bits>(detail::fused<false, false>(a.v, b.v, c.v));
}
template <class T, int W, int Bits>
requires(detail::fuses<Bits>) inline Lanes<T, W, Bits> less_product(Lanes<T, W, Bits> c, Lanes<T, W, Bits> a,
                                                                    Lanes<T, W, Bits> b) {
    if constexpr (W == 1)
        return std::fma(-a.v, b.v, c.v);
    else
        return Lanes<T, W, Bits>(detail::fused<true, false>(a.v, b.v, c.v));
}
template <class T, int W, int Bits>
requires(detail::fuses<Bits>) inline Lanes<T, W, Bits> product_less(Lanes<T, W, Bits> a, Lanes<T, W, Bits> b,
                                                                    Lanes<T, W, Bits> c) {
    if constexpr (W == 1)
        return std::fma(a.v, b.v, -c.v);
    else
        return Lanes<T, W, Bits>(detail::fused<false, true>(a.v, b.v, c.v));
}

/// The larger of a and b; b where either is NaN.
template <class Real>
inline Real maximum(Real a, Real b) {
    return select(a > b, a, b);
}
/// The smaller of a and b; b where either is NaN.
template <class Real>
inline Real minimum(Real a, Real b) {
    return select(a < b, a, b);
}
template <class Real>
inline Real absolute(Real a) {
    return select(a < Real(0), -a, a);
}
template <class Real>
inline Real clamp(Real a, Real low, Real high) {
    return minimum(maximum(a, low), high);
}

/// True where the number is finite: x - x is zero exactly then.
template <class Real>
inline MaskOf<Real> finite(Real a) {
    return absolute(a - a) <= Real(0);
}

// ---- memory: arrays are [index][lane] of the scalar type -----------------------------------------

namespace detail {
/// A register's numbers where they stand in memory. It is numbers that a kernel writes through it: had they been copied
/// as bytes, the compiler would read every index and pointer anew after each.
template <class Real>
struct InMemory {
    typedef typename Real::Vector Vector __attribute__((aligned(alignof(ScalarOf<Real>))));
};
}  // namespace detail

template <class Real>
inline Real load(const ScalarOf<Real>* p) {
    if constexpr (lane_width<Real> == 1)
        return *p;
    else
        return Real(typename Real::Vector(*reinterpret_cast<const typename detail::InMemory<Real>::Vector*>(p)));
}
template <class Real>
inline ScalarOf<Real> lane(const Real& a, int i) {
    if constexpr (std::is_arithmetic_v<Real>)
        return a;
    else if constexpr (lane_width<Real> == 1)
        return a.v;
    else
        return a.v[i];
}
template <class Real>
inline void store(ScalarOf<Real>* p, Real a) {
    if constexpr (lane_width<Real> == 1)
        *p = lane(a, 0);
    else
        *reinterpret_cast<typename detail::InMemory<Real>::Vector*>(p) = a.v;
}
/// Copies `count` numbers: a multiple of three, and fewer than a register takes.
template <class Real>
inline void copy_triples(ScalarOf<Real>* to, const ScalarOf<Real>* from, int count) {
#if defined(__AVX512F__)
    if constexpr (sizeof(Real) == 64 && sizeof(ScalarOf<Real>) == 4) {
        const __mmask16 mask = __mmask16((1u << count) - 1);
        return _mm512_mask_storeu_ps(to, mask, _mm512_maskz_loadu_ps(mask, from));
    } else if constexpr (sizeof(Real) == 64 && sizeof(ScalarOf<Real>) == 8) {
        const __mmask8 mask = __mmask8((1u << count) - 1);
        return _mm512_mask_storeu_pd(to, mask, _mm512_maskz_loadu_pd(mask, from));
    }
#endif
    for (int i = 0; i < count; i += 3) std::memcpy(to + i, from + i, 3 * sizeof(*to));
}
template <class Real>
inline void set_lane(Real& a, int i, ScalarOf<Real> s) {
    if constexpr (lane_width<Real> == 1)
        a = Real(s);
    else
        a.v[i] = s;
}

/// Part k of a whole register.
template <class Part, class Whole>
inline Part get_part(const Whole& whole, int k) {
    Part part;
    std::memcpy(&part.v, reinterpret_cast<const char*>(&whole.v) + k * sizeof(part.v), sizeof(part.v));
    return part;
}
template <class Part, class Whole>
inline void set_part(Whole& whole, int k, const Part& part) {
    std::memcpy(reinterpret_cast<char*>(&whole.v) + k * sizeof(part.v), &part.v, sizeof(part.v));
}

/// A mask whose lane i is `bits` bit i.
template <class Real>
inline MaskOf<Real> mask_from_bits(unsigned bits) {
    if constexpr (lane_width<Real> == 1) {
        return (bits & 1u) != 0;
    } else {
        MaskOf<Real> m{};
        for (int i = 0; i < lane_width<Real>; ++i) m.bits[i] = (bits >> i) & 1u ? -1 : 0;
        return m;
    }
}
template <class Real>
inline unsigned bits_from_mask(MaskOf<Real> m) {
    if constexpr (lane_width<Real> == 1) {
        return m ? 1u : 0u;
    } else {
        return detail::sign_bits(m);
    }
}

}  // namespace palpate
