#pragma once
// A lane type holds one number per finger: `Lanes<T, W>` carries W fingers in one SIMD register
// group, and plain `double` / `float` is the one-lane case. Kernels are templates over the lane type
// and use only the functions below, so that one text serves the reference and the real-time solver.

#include <cmath>
#include <cstdint>
#include <cstring>
#include <type_traits>

namespace palpate {

template <class T>
struct MaskInteger {
    using type = std::conditional_t<sizeof(T) == 8, std::int64_t, std::int32_t>;
};

/// Result of comparing lanes: all bits set where true.
template <class T, int W>
struct LaneMask {
    typedef typename MaskInteger<T>::type Vector __attribute__((vector_size(sizeof(T) * W)));
    Vector bits;

    friend LaneMask operator&(LaneMask a, LaneMask b) { return {a.bits & b.bits}; }
    friend LaneMask operator|(LaneMask a, LaneMask b) { return {a.bits | b.bits}; }
    friend LaneMask operator!(LaneMask a) { return {~a.bits}; }
};

template <class T, int W>
struct Lanes {
    static_assert(W > 1 && (W & (W - 1)) == 0, "a power of two");
    typedef T Vector __attribute__((vector_size(sizeof(T) * W)));
    using Mask = LaneMask<T, W>;
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

/// One lane that is not the plain scalar type: its code, compiled for a wider processor, has names of its own.
template <class T>
struct Lanes<T, 1> {
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
template <class T, int W>
struct LaneTraits<Lanes<T, W>> {
    using Scalar = T;
    using Mask = LaneMask<T, W>;
    static constexpr int width = W;
};
template <class T>
struct LaneTraits<Lanes<T, 1>> {
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

/// Lanes that one finger alone can fill with work of its own (several elements, the rows of a block); void where the
/// lanes already are fingers, or the processor's are not known to be wide.
template <class Real>
struct OwnLanes {
    using type = void;
};
template <class T>
struct OwnLanes<Lanes<T, 1>> {
    using type = Lanes<T, 32 / sizeof(T)>;
};
template <class Real>
inline constexpr bool has_own_lanes = !std::is_void_v<typename OwnLanes<Real>::type>;

// ---- selection and reduction; a comparison with NaN is false in every lane ----------------------

inline double select(bool m, double a, double b) { return m ? a : b; }
inline float select(bool m, float a, float b) { return m ? a : b; }
template <class T>
inline Lanes<T, 1> select(bool m, Lanes<T, 1> a, Lanes<T, 1> b) {
    return m ? a : b;
}
template <class T, int W>
inline Lanes<T, W> select(LaneMask<T, W> m, Lanes<T, W> a, Lanes<T, W> b) {
    return Lanes<T, W>(m.bits ? a.v : b.v);
}
template <class T, int W>
inline Lanes<T, W> select(LaneMask<T, W> m, Lanes<T, W> a, T b) {
    return select(m, a, Lanes<T, W>(b));
}
template <class T, int W>
inline Lanes<T, W> select(LaneMask<T, W> m, T a, Lanes<T, W> b) {
    return select(m, Lanes<T, W>(a), b);
}

inline bool any(bool m) { return m; }
inline bool all(bool m) { return m; }
template <class T, int W>
inline bool any(LaneMask<T, W> m) {
    typename MaskInteger<T>::type r = 0;
    for (int i = 0; i < W; ++i) r |= m.bits[i];
    return r != 0;
}
template <class T, int W>
inline bool all(LaneMask<T, W> m) {
    return !any(!m);
}

// ---- arithmetic that the operators do not cover -------------------------------------------------

inline double square_root(double a) { return std::sqrt(a); }
inline float square_root(float a) { return std::sqrt(a); }
template <class T>
inline Lanes<T, 1> square_root(Lanes<T, 1> a) {
    return std::sqrt(a.v);
}
template <class T, int W>
inline Lanes<T, W> square_root(Lanes<T, W> a) {
    Lanes<T, W> r;
    for (int i = 0; i < W; ++i) r.v[i] = std::sqrt(a.v[i]);
    return r;
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

template <class Real>
inline Real load(const ScalarOf<Real>* p) {
    if constexpr (lane_width<Real> == 1) {
        return *p;
    } else {
        Real r;
        std::memcpy(&r.v, p, sizeof(r.v));
        return r;
    }
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
        std::memcpy(p, &a.v, sizeof(a.v));
}
template <class Real>
inline void set_lane(Real& a, int i, ScalarOf<Real> s) {
    if constexpr (lane_width<Real> == 1)
        a = Real(s);
    else
        a.v[i] = s;
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
        unsigned bits = 0;
        for (int i = 0; i < lane_width<Real>; ++i) bits |= m.bits[i] ? 1u << i : 0u;
        return bits;
    }
}

}  // namespace palpate
