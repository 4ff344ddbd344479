#pragma once
// A fit's working state: fingers with given parameters, pressed as was measured, and how far off they are.

#include <Eigen/Core>
#include <vector>

#include "scenes/studies/calibration.h"

namespace palpate {

/// Parameters are scaled to [0, 1] between their bounds.
struct Fit {
    FingerModel model;
    std::vector<FitParameter> parameters;
    const std::vector<MeasuredCurve>& data;
    const CalibrationSettings& settings;
    Threads& threads;
    FingerTemplates templates;
    int simulations = 0;
    bool fine = true;  ///< the search goes by fewer stops than what is found is polished and judged with

    bool search_is_coarse() const;
    double value(std::size_t parameter, double scaled) const;
    double scaled(std::size_t parameter, double value) const;
    FingerModel at(const Eigen::VectorXd& u) const;
    /// Curves of several fingers, [finger][press], all simulated at once.
    std::vector<std::vector<IndentationCurve>> press(const std::vector<FingerModel>& models);
    /// Of each point: how far that finger is off the data, in units of the assumed noise.
    std::vector<Eigen::VectorXd> residuals_at(const std::vector<Eigen::VectorXd>& points);
    /// Variance of what the same press gives with other stops: forces and areas differ by some thousandths.
    double own_noise() const;
    /// Residuals of neighbouring rows that are alike, as where the model cannot follow the data, are no news each: by
    /// how much fewer of them there are, from the correlation of each row with the one before.
    double repetition(const Eigen::VectorXd& residuals) const;
};

/// How well each press is met by its simulation.
std::vector<CurveFit> errors_of(const std::vector<IndentationCurve>& curves, const std::vector<MeasuredCurve>& data);

}  // namespace palpate
