#pragma once
// The standard experiment on a finger: a flat plate is pressed on it, and force, displacement and contact area are
// read.

#include <functional>
#include <vector>

#include "engine/build.h"
#include "engine/threads.h"

namespace palpate {

/// By how much the bone stays behind where it is led, under a force [m/N].
inline constexpr double clamp_give = 1e-6;

/// One finger and how it meets the plate.
struct Indentation {
    FingerSpec finger;    ///< its coupling, start pose, filter and precision are not used
    double angle = 0;     ///< between plate and finger axis [rad]: 0 = the pad lies flat, pi/2 = tip on
    double roll = 0;      ///< about the finger's axis [rad]
    double depth = 3e-3;  ///< displacement at the end, from first touch of the curved skin [m]
    std::vector<double> displacements = {};  ///< those to lead to, rising [m]; empty: equal steps to the depth
};

/// State of one finger at one displacement.
struct IndentationPoint {
    double displacement = 0;    ///< of the bone towards the plate, from where the curved skin touches it [m]
    double force = 0;           ///< normal to the plate [N]
    double area = 0;            ///< of the contact patch [m^2]
    double hull = 0;            ///< of its convex hull, as an ink print would show it [m^2]
    double surface_strain = 0;  ///< principal strain, by magnitude, that a fiftieth of the touching skin exceeds
    int touching = 0;           ///< samples
    int limited = 0;            ///< elements at a strain limit
    bool converged = false;
};

struct IndentationSettings {
    int steps = 30;           ///< equal displacements up to the depth
    double force_limit = 0;   ///< a finger that carries more than this goes no deeper [N]; 0: never
    double speed = 0;         ///< of the plate [m/s]; 0: quasi-static. Tissue has inertia, but no viscosity
    double friction = 0;      ///< of the plate
    double shear = 0;         ///< after that, moved across the plate, to the radial side, by this [m]
    int shear_steps = 20;     ///< in so many steps
    double tolerance = 1e-5;  ///< of the solve, relative to the forces acting
    std::function<void(double)> progress = {};  ///< told the share that is done
    /// Shown each finger (its number) at each displacement of the press.
    std::function<void(std::size_t, const IndentationPoint&, const ContactSurface&)> observe = {};
};

/// State of one finger on its way across the plate.
struct ShearPoint {
    double shift = 0;           ///< of the bone [m]
    double force = 0;           ///< across the plate [N]
    double surface_strain = 0;  ///< as in IndentationPoint
    bool converged = false;
};

struct IndentationCurve {
    std::vector<IndentationPoint> points;  ///< the first is first touch: all zero
    std::vector<ShearPoint> shear;         ///< where it was asked for; the first is the end of the press
};

/// Presses all fingers at once; fingers of one connectivity share SIMD lanes. A step that does not converge is marked.
std::vector<IndentationCurve> indent(const std::vector<Indentation>& fingers, const IndentationSettings& settings,
                                     Threads& threads);

/// What is mostly told of a fingertip, at one angle. NaN where the press did not get that far.
struct FingertipFigures {
    double displacement_1N = 0, displacement_4N = 0;  ///< [m]
    double stiffening = 0;                            ///< secant stiffness at 4 N over that at 0.5 N
    double area_1N = 0, area_5N = 0;                  ///< [m^2]
    double area_exponent = 0;                         ///< of area over force, from 0.2 to 5 N
    double strain_5N = 0;                             ///< of the surface, pressed
    double sheared_strain_5N = 0;                     ///< of the surface, pressed and moved across until it slides
    double tangential_stiffness_1N = 0;               ///< at the start of that way [N/m]
};
/// The figures of a curve without friction; those of shear come from presses with friction, to 1 N and to 5 N.
FingertipFigures fingertip_figures(const Indentation& finger, const IndentationCurve& curve, double friction,
                                   Threads& threads);

/// Area of the convex hull of points [m^2].
double hull_area(std::vector<std::array<double, 2>> points);

/// Value of a curve's field at a displacement or force: monotone between points, the last slope beyond.
double displacement_at_force(const IndentationCurve& curve, double force);
double field_at_displacement(const IndentationCurve& curve, double displacement, double IndentationPoint::*field);
double field_at_force(const IndentationCurve& curve, double force, double IndentationPoint::*field);

}  // namespace palpate
