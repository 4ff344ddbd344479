#pragma once
// The bodies at the two ends of a contact between objects.

#include "engine/bodies/islands.h"

namespace palpate {

/// Calls visit(body, term's motion matrix) for the bodies of a pair that a term pushes; b moves against a.
template <class Visit>
void for_each_end(BodyWork& w, const BodyPair& p, const PairTerm& t, Visit visit) {
    if (w.shapes[p.a].body >= 0) visit(w.s.bodies[w.shapes[p.a].body], point_motion(t.arm_of_a));
    if (w.shapes[p.b].body >= 0)
        visit(w.s.bodies[w.shapes[p.b].body], Eigen::Matrix<double, 3, 6>(-point_motion(t.arm_of_b)));
}

inline Eigen::Vector3d eigen(const Vec3<double>& v) { return {v.x, v.y, v.z}; }
inline Eigen::Matrix3d eigen(const Mat3<double>& m) {
    return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(&m.m[0][0]);
}

}  // namespace palpate
