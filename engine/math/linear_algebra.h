#pragma once
// Vectors and matrices of three, over any lane type.

#include "engine/math/lanes.h"

namespace palpate {

template <class R>
struct Vec3 {
    R x, y, z;
    R& operator[](int i) { return i == 0 ? x : i == 1 ? y : z; }
    const R& operator[](int i) const { return i == 0 ? x : i == 1 ? y : z; }

    friend Vec3 operator+(const Vec3& a, const Vec3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
    friend Vec3 operator-(const Vec3& a, const Vec3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
    friend Vec3 operator-(const Vec3& a) { return {-a.x, -a.y, -a.z}; }
    friend Vec3 operator*(const R& s, const Vec3& a) { return {s * a.x, s * a.y, s * a.z}; }
    Vec3& operator+=(const Vec3& b) { return *this = *this + b; }
    Vec3& operator-=(const Vec3& b) { return *this = *this - b; }
};

template <class R>
inline R dot(const Vec3<R>& a, const Vec3<R>& b) {
    return plus_product(plus_product(a.x * b.x, a.y, b.y), a.z, b.z);
}
template <class R>
inline Vec3<R> cross(const Vec3<R>& a, const Vec3<R>& b) {
    return {product_less(a.y, b.z, a.z * b.y), product_less(a.z, b.x, a.x * b.z), product_less(a.x, b.y, a.y * b.x)};
}
template <class R>
inline R norm(const Vec3<R>& a) {
    return square_root(dot(a, a));
}
template <class R>
inline Vec3<R> select(MaskOf<R> m, const Vec3<R>& a, const Vec3<R>& b) {
    return {select(m, a.x, b.x), select(m, a.y, b.y), select(m, a.z, b.z)};
}

/// Row-major 3x3 matrix: m[row][column].
template <class R>
struct Mat3 {
    R m[3][3];
    R* operator[](int i) { return m[i]; }
    const R* operator[](int i) const { return m[i]; }

    static Mat3 filled(const R& s) { return {{{s, s, s}, {s, s, s}, {s, s, s}}}; }
    static Mat3 zero() { return filled(R(0)); }
    static Mat3 identity() {
        Mat3 a = zero();
        for (int i = 0; i < 3; ++i) a.m[i][i] = R(1);
        return a;
    }
    Vec3<R> column(int j) const { return {m[0][j], m[1][j], m[2][j]}; }
    void set_column(int j, const Vec3<R>& c) {
        m[0][j] = c.x;
        m[1][j] = c.y;
        m[2][j] = c.z;
    }

    friend Mat3 operator+(const Mat3& a, const Mat3& b) {
        Mat3 c;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) c.m[i][j] = a.m[i][j] + b.m[i][j];
        return c;
    }
    friend Mat3 operator-(const Mat3& a, const Mat3& b) {
        Mat3 c;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) c.m[i][j] = a.m[i][j] - b.m[i][j];
        return c;
    }
    friend Mat3 operator*(const R& s, const Mat3& a) {
        Mat3 c;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) c.m[i][j] = s * a.m[i][j];
        return c;
    }
    friend Mat3 operator*(const Mat3& a, const Mat3& b) {
        Mat3 c;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                c.m[i][j] =
                    plus_product(plus_product(a.m[i][0] * b.m[0][j], a.m[i][1], b.m[1][j]), a.m[i][2], b.m[2][j]);
        return c;
    }
    friend Vec3<R> operator*(const Mat3& a, const Vec3<R>& v) {
        const auto row = [&](const R* r) { return dot(Vec3<R>{r[0], r[1], r[2]}, v); };
        return {row(a.m[0]), row(a.m[1]), row(a.m[2])};
    }
};

template <class R>
inline Mat3<R> select(MaskOf<R> m, const Mat3<R>& a, const Mat3<R>& b) {
    Mat3<R> c;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) c.m[i][j] = select(m, a.m[i][j], b.m[i][j]);
    return c;
}
template <class R>
inline Mat3<R> transpose(const Mat3<R>& a) {
    Mat3<R> t;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) t.m[i][j] = a.m[j][i];
    return t;
}
/// a b^T without forming the transpose.
template <class R>
inline Mat3<R> times_transposed(const Mat3<R>& a, const Mat3<R>& b) {
    Mat3<R> c;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            c.m[i][j] = plus_product(plus_product(a.m[i][0] * b.m[j][0], a.m[i][1], b.m[j][1]), a.m[i][2], b.m[j][2]);
    return c;
}
/// a^T v.
template <class R>
inline Vec3<R> transposed_times(const Mat3<R>& a, const Vec3<R>& v) {
    return {dot(a.column(0), v), dot(a.column(1), v), dot(a.column(2), v)};
}
template <class R>
inline Mat3<R> outer(const Vec3<R>& a, const Vec3<R>& b) {
    Mat3<R> c;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) c.m[i][j] = a[i] * b[j];
    return c;
}
/// The matrix of the cross product: skew(a) b = a x b.
template <class R>
inline Mat3<R> skew(const Vec3<R>& a) {
    const R o(0);
    return {{{o, -a.z, a.y}, {a.z, o, -a.x}, {-a.y, a.x, o}}};
}

/// skew(a) B: the cross product of a with every column of B.
template <class R>
inline Mat3<R> cross_columns(const Vec3<R>& a, const Mat3<R>& B) {
    Mat3<R> c;
    for (int j = 0; j < 3; ++j) c.set_column(j, cross(a, B.column(j)));
    return c;
}

template <class R>
inline Vec3<R> load_vec3(const ScalarOf<R>* p) {
    constexpr int W = lane_width<R>;
    return {load<R>(p), load<R>(p + W), load<R>(p + 2 * W)};
}
template <class R>
inline void store_vec3(ScalarOf<R>* p, const Vec3<R>& a) {
    constexpr int W = lane_width<R>;
    store<R>(p, a.x);
    store<R>(p + W, a.y);
    store<R>(p + 2 * W, a.z);
}
template <class R>
inline Mat3<R> load_mat3(const ScalarOf<R>* p) {
    constexpr int W = lane_width<R>;
    Mat3<R> a;
    for (int i = 0; i < 9; ++i) a.m[i / 3][i % 3] = load<R>(p + i * W);
    return a;
}
template <class R>
inline void store_mat3(ScalarOf<R>* p, const Mat3<R>& a) {
    constexpr int W = lane_width<R>;
    for (int i = 0; i < 9; ++i) store<R>(p + i * W, a.m[i / 3][i % 3]);
}

}  // namespace palpate
