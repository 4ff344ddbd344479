#pragma once
// Fits a finger to measured indentations.

#include <atomic>
#include <functional>

#include "scenes/load/finger_model.h"
#include "scenes/studies/fit_parameters.h"
#include "scenes/studies/indentation.h"
#include "scenes/studies/measured_curves.h"

namespace palpate {

struct CalibrationSettings {
    std::vector<std::string> parameters{"young_kPa", "low", "width_mm"};
    int starts = 3;       ///< local fits, from the best of five times as many points spread over the bounds
    int iterations = 15;  ///< most of one local fit
    /// Where up to twice as many rows of a press were measured, they are simulated as they were measured. Of more, the
    /// search takes one and a half times as many, close together where the curve bends; what it finds is fitted again,
    /// and judged, with up to eight times as many.
    int steps = 16;
    double noise = 0.05;  ///< assumed relative error of forces and areas: their weight against each other
    double friction = 0;  ///< of the plate
};

/// What was found for one parameter.
struct FittedParameter {
    std::string name;
    double value = 0;
    /// 95 % confidence interval, clipped to the bounds. Its noise is that of the residuals, at least two thousandths;
    /// rows that are off alike count as fewer.
    double low95 = 0, high95 = 0;
    bool determined = true;  ///< false: the interval spans more than half of the bounds, or the value lies on one
};

/// How well one press is met.
struct CurveFit {
    double angle = 0;               ///< [rad]
    double force_area = 0;          ///< mean relative error of the area at the measured forces; NaN without areas
    double displacement_force = 0;  ///< mean relative error of the displacement at the measured forces; NaN without
    IndentationCurve model;         ///< simulated with what was found
};

struct Calibration {
    FingerModel model;
    std::vector<FittedParameter> parameters;
    std::vector<CurveFit> curves;
    double cost = 0;      ///< mean squared residual, in units of the assumed noise: about 1 where the model can be true
    int simulations = 0;  ///< fingers pressed
    bool converged = false;
};

/// Bounded Levenberg-Marquardt from several starts on the logarithms of force and area at the
/// measured displacements (without those, of area at the measured forces). All fingers of an iteration, one per
/// parameter and angle, are simulated together. Throws InputError where a parameter does not exist or there are fewer
/// points than parameters.
Calibration calibrate(const FingerModel& start, const std::vector<MeasuredCurve>& data,
                      const CalibrationSettings& settings, Threads& threads, const std::atomic<bool>& stop,
                      const std::function<void(const std::string&)>& progress);

/// How far a model is off measured curves, without fitting.
std::vector<CurveFit> compare_with_curves(const FingerModel& model, const std::vector<MeasuredCurve>& data,
                                          const CalibrationSettings& settings, Threads& threads);

}  // namespace palpate
