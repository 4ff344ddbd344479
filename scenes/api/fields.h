#pragma once
// Fields that views show: what they are of, and their numbers.

#include "scenes/api/session.h"

namespace palpate::api {

/// `object`: a soft one.
enum class Of { finger, object, thimble, world };
struct FieldKind {
    Of of;
    std::int32_t type;
    bool changes;    ///< from step to step
    bool by_object;  ///< a row for each object: another size where one comes or goes
};
/// 0 to PALPATE_FIELD_COUNT - 1.
const FieldKind& kind_of(int field);
/// Row of an id of a field; -1 where there is none, or the field is the world's.
int row_of(const Session& session, int field, std::int32_t id);
/// Writes the numbers of a row's field as they are now; takes memory the first time alone.
void fill(Session& session, int field, int row, FieldMemory& memory);

inline void put(double* out, const Vec3<double>& v) { out[0] = v.x, out[1] = v.y, out[2] = v.z; }
inline void put(double* out, const Pose<double>& p) {
    put(out, p.position);
    out[3] = p.rotation.w, out[4] = p.rotation.x, out[5] = p.rotation.y, out[6] = p.rotation.z;
}
/// The newest that was seen; at first the one that it began with.
Pose<double> tracked_pose(const World& world, std::size_t finger);

}  // namespace palpate::api
