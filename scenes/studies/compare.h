#pragma once
// The paper's error analysis: what would the pad feel on the device, against what it should feel.

#include "scenes/run/simulation.h"

namespace palpate {

/// The pad of one finger, fixed at the nail, pressed by a thimble's platform.
struct PadOnPlatform {
    World world;
    EntityId finger;
};
PadOnPlatform make_pad_on_platform(const FingerSpec& finger, const DeviceModel& model);

/// Puts the platform to configuration w and solves for static equilibrium; the pad's contact is then in
/// pad.world.contact_surfaces[0]. Returns whether the solve met its tolerances.
bool resimulate(PadOnPlatform& pad, const DeviceModel& model, const Coordinates& w, Threads& threads);

/// How the rendered contact differs from the wanted one. Finger frame.
struct RenderingError {
    double field_N = 0;      ///< sum of |F_i - Fbar_i|
    double normal_N = 0;     ///< sum of its parts along the contact's normals: what a platform can render
    double shear_N = 0;      ///< sum of its parts across them: a platform without friction renders none
    double net_N = 0;        ///< |sum F_i - sum Fbar_i|
    double torque_Nmm = 0;   ///< of the forces, about the finger's origin
    double area_mm2 = 0;     ///< of samples that touch in one and not in the other
    double centroid_mm = 0;  ///< between the centres of pressure; 0 where one is without force
};

/// One rendering step of one finger.
struct ComparedStep {
    double time = 0, roll_deg = 0;
    double virtual_force_N = 0;  ///< sum of |F_i| of the virtual contact
    double virtual_shear_N = 0;  ///< sum of their parts across the contact's normals
    struct Method {
        MatchingResult result;
        RenderingError error;
        bool converged = false;
        bool by_least_squares = false;  ///< a descent from beside the contact has beaten SLSQP
        double microseconds = 0;        ///< of the match
    };
    std::vector<Method> methods;  ///< as asked for
};

struct CompareOptions {
    std::vector<MatchingMethod> methods{MatchingMethod::constrained, MatchingMethod::unconstrained,
                                        MatchingMethod::plane, MatchingMethod::force};
    bool through_servo = false;  ///< what a simulated servo makes of it: quantised and delayed
};

/// Runs the scene; at each rendering step of each thimble matches with every method and simulates the pad again.
std::vector<std::vector<ComparedStep>> compare(Simulation& simulation, const CompareOptions& options,
                                               const std::atomic<bool>& stop,
                                               const std::function<void(double)>& progress);

}  // namespace palpate
