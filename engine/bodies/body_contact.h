#pragma once
// Contact between objects of which at least one is a body: points of one against the signed distance of the other.

#include <array>
#include <vector>

#include "engine/bodies/rigid_body.h"
#include "engine/contact/contact_terms.h"

namespace palpate {

/// A point of an object at which contact with other objects is decided: a corner, edge or face's middle of a box (as a
/// little ball), the middle of a ball (radius > 0), the middle of a disc (with its axis), of which the deepest point of
/// the rim counts. Capsules and cylinders have one about every diameter. Edges, and the axes of rods, count at their
/// deepest point.
struct Feature {
    Vec3<double> point{0, 0, 0};  ///< object's frame [m]
    double radius = 0;            ///< [m]
    Vec3<double> axis{0, 0, 0};   ///< of a disc; zero for balls and points
    /// Half of an edge, or of a rod's axis, of which `point` is the middle; else zero [m].
    Vec3<double> along{0, 0, 0};
    Vec3<double> facing{0, 0, 0};  ///< outward normal of the flat face that it stands for; else zero
};

/// Features of a shape against others, or against planes, where the outermost corners of a mesh do; none for a plane.
std::vector<Feature> features_of(const Shape& shape, bool against_planes);

/// An object as contact between objects sees it.
struct ContactBody {
    const Shape* shape = nullptr;
    Pose<double> start, pose;      ///< of the object, at the beginning of the step and now
    Vec3<double> centre{0, 0, 0};  ///< of mass, now; what its motions turn about
    int body = -1;                 ///< row of its body; -1: fixed or scripted
    double speed = 0;              ///< of its fastest point, before the step [m/s]
    bool still = false;            ///< asleep, or fixed
    Vec3<double> turn{0, 0, 0};    ///< about as it turns in the step, whole revolutions with it, world [rad]
};

/// One push on both objects of a pair: a gradient and curvature at one point.
struct PairTerm {
    Vec3<double> gradient{0, 0, 0};  ///< along the way of a's point relative to b [N]
    Mat3<double> curvature = Mat3<double>::zero();
    Vec3<double> arm_of_a{0, 0, 0}, arm_of_b{0, 0, 0};  ///< from the centres to the point [m]
    bool acts = false;                                  ///< else gradient and curvature count as zero
};

/// A feature of object a against object b.
struct FeatureContact {
    double normal_multiplier = 0;                           ///< [N]
    Vec3<double> tangential_multiplier{0, 0, 0};            ///< b's frame [N]
    double friction_radius = 0;                             ///< [N]
    Vec3<double> friction_normal{0, 0, 0};                  ///< b's frame
    Vec3<double> point_of_a{0, 0, 0}, point_of_b{0, 0, 0};  ///< their distance is the step's slip, each in its frame
    double normal_candidate = 0;                            ///< at the last evaluation
    Vec3<double> tangential_candidate{0, 0, 0};             ///< b's frame
    Vec3<double> normal_now{0, 0, 0};                       ///< b's frame
    double distance = 0;                                    ///< [m]
    int side = 0;                                           ///< of b that it is on (sided_point)
    double place = 0;               ///< on an edge: `point` plus so many times `along`, for the whole step
    double blunt = 1e-6;            ///< tilt below which a disc's deepest point is between its middle and its rim [rad]
    Vec3<double> rim{0, 0, 0};      ///< from a disc's middle to its point of the step, a's frame (set_rim); or zero [m]
    Vec3<double> exit{0, 0, 0};     ///< b's frame: the face that it leaves b by (find_exit_face); zero: the nearest
    double reach = 0;               ///< of b along that way [m]
    Vec3<double> face{0, 0, 0};     ///< of b, world, that a fast feature meets first (stop_at_first_face); or zero
    Vec3<double> met{0, 0, 0};      ///< b's frame: the point of b that it meets there
    double approach = 0;            ///< speed of approach at the start [m/s]
    double offset = 0;              ///< gap at which it touches: below 0 while an overlap is being undone [m]
    double sunk = 0;                ///< how deep it was where the step began [m]
    double undone = 0;              ///< overlap that this step is to undo: its motion is no velocity [m]
    double parting = 0, brake = 0;  ///< speed that is left [m/s], and the impulse that takes the rest away [N s]
    double bounce = 0;              ///< impulse with which it bounces [N s]
    Vec3<double> bounce_friction{0, 0, 0};  ///< and with which it rubs then, world [N s]
    std::array<PairTerm, 2> terms;          ///< normal, friction
};

struct PairEvaluation {
    double energy = 0, pending = 0, contact_force = 0;
    double penetration = 0;  ///< beyond what the step leaves of an overlap at its start [m]
};

/// Two objects near each other: `a` brings the features.
struct BodyPair {
    int a = -1, b = -1;                    ///< rows of objects; -1: unused
    double friction = 0;                   ///< Coulomb coefficient
    double penalty = 2e5;                  ///< [N/m]
    bool near = false;                     ///< found near in this step
    std::vector<FeatureContact> contacts;  ///< [feature of a against b]
    PairEvaluation evaluation;             ///< the last
};

/// The deepest point of a feature in an object, and the object's distance and normal there, world.
struct Touch {
    Vec3<double> point;
    SurfacePoint<double> surface;
};
/// A ball's distance is that of its middle less its radius, which has a gradient at edges, too. The rim of a disc that
/// stands nearly upright has no one deepest point: below the tilt `blunt` it moves in to the middle, as the depth that
/// goes with it does (Huber's function). Where that is no rule, it has one point for all of a step (`rim`).
Touch touch_of(const Feature& feature, const Pose<double>& a, const FeatureContact& contact, const Shape& shape,
               const Pose<double>& b, int side);

/// Start of a step: which points touch, for friction.
void begin_pair(BodyPair& pair, const std::vector<Feature>& features, const ContactBody& a, const ContactBody& b);

/// Where weight would carry a point through an object, or past its middle, before the first guess has it move at all
/// (a stack of thin things in long steps), it meets the face that it comes to first, too. `a_falls`, `b_falls`: where
/// the objects would be without contact.
void stop_falls(BodyPair& pair, const std::vector<Feature>& features, const ContactBody& a, const ContactBody& b,
                const Pose<double>& a_falls, const Pose<double>& b_falls);
/// Features that are inside b, and whose nearest faces are not all one, would be pressed out of several at once, as a
/// box that stands beside another is at its top, foot and side: all of them leave by the face of which the deepest is
/// least deep. Of boxes and cylinders these are their faces, of others the planes at which features inside them are
/// nearest to their surface; among the features whose overlap undo_overlap() undoes. Returns whether it was so.
bool find_exit_face(BodyPair& pair, const std::vector<Feature>& features, const ContactBody& a, const ContactBody& b);
/// Distance and normal of b at a point of a feature, both world, with b where `pose` is.
SurfacePoint<double> surface_at(const FeatureContact& contact, const Shape& b, const Pose<double>& pose,
                                const Vec3<double>& point, int side);
/// A contact that begins its step with an `overlap` of more than `begins` [m] gives way by `recovery` [m] in this step,
/// until none is left.
void undo_overlap(FeatureContact& contact, double overlap, double begins, double recovery);

/// Evaluates all contacts of a pair at the objects' poses; writes their terms and candidates.
PairEvaluation evaluate_pair(BodyPair& pair, const std::vector<Feature>& features, const ContactBody& a,
                             const ContactBody& b, double exactness);

/// Candidates become multipliers; where overlaps are being undone, at the end of the step alone: until then they have
/// springs and no multipliers, because what they ask for may contradict each other.
void update_pair(BodyPair& pair, bool at_end_of_step);
/// A light body under a load is as stiffly held as the load asks for: a tenth of a millimetre of it [N/m].
double load_penalty(const BodyPair& pair);

/// Way of a body's point at `arm` from its centre of mass when the body moves: d = G motion.
inline Eigen::Matrix<double, 3, 6> point_motion(const Vec3<double>& arm) {
    const Mat3<double> turn = skew(arm);
    Eigen::Matrix<double, 3, 6> G;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) G(i, j) = i == j, G(i, 3 + j) = -turn[i][j];
    return G;
}

}  // namespace palpate
