#include "bench/batched_kernel.h"

#include <cstddef>
#include <cstring>

namespace palpate {
namespace {

typedef float Eight __attribute__((vector_size(4 * batch)));
constexpr float young = 30e3f, poisson = 0.45f, inertia = 10;

inline Eight get(const float* p) {
    Eight v;
    std::memcpy(&v, p, sizeof v);
    return v;
}
inline void put(float* p, Eight v) { std::memcpy(p, &v, sizeof v); }
inline Eight root(Eight v) {
    for (int i = 0; i < batch; ++i) v[i] = __builtin_sqrtf(v[i]);
    return v;
}

struct Three {
    Eight m[3][3];
};
inline Three get_three(const float* p) {
    Three a;
    for (int i = 0; i < 9; ++i) a.m[i / 3][i % 3] = get(p + i * batch);
    return a;
}
inline void put_three(float* p, const Three& a) {
    for (int i = 0; i < 9; ++i) put(p + i * batch, a.m[i / 3][i % 3]);
}

/// One of Newton's iterations towards the nearest rotation: (R + R^-T) / 2.
inline void polar_iteration(Three& R) {
    Three C;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            const int p = (i + 1) % 3, q = (i + 2) % 3, s = (j + 1) % 3, t = (j + 2) % 3;
            C.m[i][j] = R.m[p][s] * R.m[q][t] - R.m[p][t] * R.m[q][s];
        }
    const Eight inverse = 0.5f / (R.m[0][0] * C.m[0][0] + R.m[0][1] * C.m[0][1] + R.m[0][2] * C.m[0][2]);
    for (int i = 0; i < 9; ++i) R.m[i / 3][i % 3] = 0.5f * R.m[i / 3][i % 3] + inverse * C.m[i / 3][i % 3];
}

}  // namespace

void assemble_batch(const BatchedFingers& f) {
    const float mu = young / (2 * (1 + poisson)), lambda = young * poisson / ((1 + poisson) * (1 - 2 * poisson));
    std::memset(f.matrix, 0, sizeof(float) * 9 * batch * std::size_t(f.column_start[f.columns]));
    std::memset(f.force, 0, sizeof(float) * 3 * batch * std::size_t(f.columns));
    for (int c = 0; c < f.columns; ++c)
        for (int i = 0; i < 3; ++i) put(f.matrix + (9 * f.column_start[c] + 4 * i) * batch, Eight{} + inertia);
    for (int e = 0; e < f.elements; ++e) {
        const int* nodes = f.nodes + 4 * e;
        Eight g[4][3], x0[3];
        Three F;
        for (int i = 0; i < 3; ++i) {
            x0[i] = get(f.position + (3 * nodes[0] + i) * batch);
            for (int a = 1; a < 4; ++a) g[a][i] = get(f.gradients + (9 * e + 3 * (a - 1) + i) * batch);
            g[0][i] = -(g[1][i] + g[2][i] + g[3][i]);
        }
        for (int i = 0; i < 3; ++i) {
            Eight d[4];
            for (int a = 1; a < 4; ++a) d[a] = get(f.position + (3 * nodes[a] + i) * batch) - x0[i];
            for (int j = 0; j < 3; ++j) F.m[i][j] = d[1] * g[1][j] + d[2] * g[2][j] + d[3] * g[3][j];
        }
        Three R = F;
        for (int k = 0; k < 3; ++k) polar_iteration(R);
        // P = R (2 mu (S - I) + lambda tr(S - I) I) = 2 mu (F - R) + lambda tr(R^T F - I) R
        Eight trace = Eight{} - 3.0f;
        for (int i = 0; i < 9; ++i) trace += R.m[i / 3][i % 3] * F.m[i / 3][i % 3];
        const Eight volume = get(f.volume + e * batch);
        Three P;
        for (int i = 0; i < 9; ++i)
            P.m[i / 3][i % 3] =
                volume * (2 * mu * (F.m[i / 3][i % 3] - R.m[i / 3][i % 3]) + lambda * trace * R.m[i / 3][i % 3]);
        Eight r[4][3];
        for (int a = 0; a < 4; ++a) {
            const int c = f.unknown[nodes[a]];
            for (int i = 0; i < 3; ++i) {
                r[a][i] = R.m[i][0] * g[a][0] + R.m[i][1] * g[a][1] + R.m[i][2] * g[a][2];
                if (c < 0) continue;
                float* to = f.force + (3 * c + i) * batch;
                put(to, get(to) - (P.m[i][0] * g[a][0] + P.m[i][1] * g[a][1] + P.m[i][2] * g[a][2]));
            }
        }
        for (int a = 0; a < 4; ++a)
            for (int b = 0; b < 4; ++b) {
                const int block = f.blocks_of[16 * e + 4 * a + b];
                if (block < 0) continue;
                Three K = get_three(f.matrix + 9 * block * batch);
                const Eight direct = volume * mu * (r[a][0] * r[b][0] + r[a][1] * r[b][1] + r[a][2] * r[b][2]);
                for (int i = 0; i < 3; ++i) {
                    const Eight la = volume * lambda * r[a][i], mb = volume * mu * r[b][i];
                    for (int j = 0; j < 3; ++j) K.m[i][j] += la * r[b][j] + mb * r[a][j];
                    K.m[i][i] += direct;
                }
                put_three(f.matrix + 9 * block * batch, K);
            }
    }
}

void solve_batch(const BatchedFingers& f) {
    for (int c = 0; c < f.columns; ++c) {
        Three L{};
        for (int b = f.column_start[c]; b < f.column_start[c + 1]; ++b) {
            Three S = get_three(f.matrix + 9 * b * batch);
            for (int u = f.update_start[b]; u < f.update_start[b + 1]; ++u) {
                const Three A = get_three(f.factor + 9 * f.update_a[u] * batch);
                const Three B = get_three(f.factor + 9 * f.update_b[u] * batch);
                for (int i = 0; i < 3; ++i)
                    for (int j = 0; j < 3; ++j)
                        S.m[i][j] -= A.m[i][0] * B.m[j][0] + A.m[i][1] * B.m[j][1] + A.m[i][2] * B.m[j][2];
            }
            if (b == f.column_start[c]) {  // the diagonal of L holds reciprocals
                for (int j = 0; j < 3; ++j) {
                    Eight pivot = S.m[j][j];
                    for (int k = 0; k < j; ++k) pivot -= L.m[j][k] * L.m[j][k];
                    L.m[j][j] = 1.0f / root(pivot);
                    for (int i = j + 1; i < 3; ++i) {
                        Eight s = S.m[i][j];
                        for (int k = 0; k < j; ++k) s -= L.m[i][k] * L.m[j][k];
                        L.m[i][j] = s * L.m[j][j];
                    }
                }
                S = L;
            } else {
                for (int i = 0; i < 3; ++i)
                    for (int j = 0; j < 3; ++j) {
                        for (int k = 0; k < j; ++k) S.m[i][j] -= S.m[i][k] * L.m[j][k];
                        S.m[i][j] *= L.m[j][j];
                    }
            }
            put_three(f.factor + 9 * b * batch, S);
        }
    }
    std::memcpy(f.step, f.force, sizeof(float) * 3 * batch * std::size_t(f.columns));
    for (int c = 0; c < f.columns; ++c) {
        Eight y[3];
        const Three L = get_three(f.factor + 9 * f.column_start[c] * batch);
        for (int i = 0; i < 3; ++i) {
            y[i] = get(f.step + (3 * c + i) * batch);
            for (int k = 0; k < i; ++k) y[i] -= L.m[i][k] * y[k];
            y[i] *= L.m[i][i];
            put(f.step + (3 * c + i) * batch, y[i]);
        }
        for (int b = f.column_start[c] + 1; b < f.column_start[c + 1]; ++b) {
            const Three A = get_three(f.factor + 9 * b * batch);
            for (int i = 0; i < 3; ++i) {
                float* to = f.step + (3 * f.row[b] + i) * batch;
                put(to, get(to) - (A.m[i][0] * y[0] + A.m[i][1] * y[1] + A.m[i][2] * y[2]));
            }
        }
    }
    for (int c = f.columns - 1; c >= 0; --c) {
        Eight y[3];
        for (int i = 0; i < 3; ++i) y[i] = get(f.step + (3 * c + i) * batch);
        for (int b = f.column_start[c] + 1; b < f.column_start[c + 1]; ++b) {
            const Three A = get_three(f.factor + 9 * b * batch);
            for (int i = 0; i < 3; ++i) {
                const Eight of_row = get(f.step + (3 * f.row[b] + i) * batch);
                for (int j = 0; j < 3; ++j) y[j] -= A.m[i][j] * of_row;
            }
        }
        const Three L = get_three(f.factor + 9 * f.column_start[c] * batch);
        for (int i = 2; i >= 0; --i) {
            for (int k = i + 1; k < 3; ++k) y[i] -= L.m[k][i] * y[k];
            y[i] *= L.m[i][i];
            put(f.step + (3 * c + i) * batch, y[i]);
        }
    }
}

const char* batched_instructions() {
#if defined(__AVX2__) && defined(__FMA__)
    return "AVX2 + FMA";
#else
    return "plain";
#endif
}

}  // namespace palpate
