#include "devices/drivers/simulated.h"

#include <algorithm>
#include <cmath>

namespace palpate {

std::vector<std::string> ServoModel::validate() const {
    std::vector<std::string> wrong;
    namespace bounds = servo_model_bounds;
    check(pulse_step_us, bounds::pulse_step_us, "the servo's pulse step", " us", wrong);
    check(us_per_rad, servo_bounds::units_per_rad, "the servo's pulse per angle", " us/rad", wrong);
    check(delay_s, bounds::delay_s, "the servo's delay", " s", wrong);
    check(slew_rad_per_s, bounds::slew_rad_per_s, "the servo's slew rate", " rad/s", wrong);
    return wrong;
}

namespace {

class SimulatedDriver final : public Driver {
  public:
    SimulatedDriver(const ServoModel& servo, const Coordinates& start) : servo_(servo), angle_(start) {
        for (auto& pulse : pulses_) pulse = {-1e9, start};
    }

    DriverStatus send(const Coordinates& q, double now, double) override {
        advance(now);
        Coordinates target(q.size());
        // Steps are counted from joint angle 0, so that both directions are alike.
        const double step = servo_.pulse_step_us / servo_.us_per_rad;
        for (int i = 0; i < q.size(); ++i) target[i] = step * std::round(q[i] / step);
        pulses_[next_] = {now + servo_.delay_s, target};
        next_ = (next_ + 1) % pulses_.size();
        return DriverStatus::ok;
    }

    bool limit_torque(const Coordinates&) override { return true; }  // nothing here pushes back

    Coordinates actual(double now) override {
        advance(now);
        return angle_;
    }

    std::vector<double> state() const override {
        std::vector<double> numbers{time_, double(next_)};
        numbers.insert(numbers.end(), angle_.begin(), angle_.end());
        for (const Pulse& p : pulses_) {
            numbers.push_back(p.due);
            numbers.insert(numbers.end(), p.target.begin(), p.target.end());
        }
        return numbers;
    }
    bool set_state(const std::vector<double>& numbers) override {
        const auto joints = std::size_t(angle_.size());
        if (numbers.size() != 2 + joints + pulses_.size() * (1 + joints)) return false;
        auto at = numbers.begin();
        const auto take = [&](Coordinates& q) {
            q = Coordinates::Zero(angle_.size());
            for (double& angle : q) angle = *at++;
        };
        time_ = *at++;
        next_ = std::size_t(*at++) % pulses_.size();
        take(angle_);
        for (Pulse& p : pulses_) {
            p.due = *at++;
            take(p.target);
        }
        return true;
    }

  private:
    struct Pulse {
        double due;
        Coordinates target;
    };

    /// Moves the shafts towards the newest pulse that is due.
    void advance(double now) {
        const double dt = std::max(0.0, now - time_);
        time_ = std::max(time_, now);
        const Pulse* newest = nullptr;
        for (const Pulse& p : pulses_)
            if (p.due <= now && (!newest || p.due > newest->due)) newest = &p;
        if (!newest) return;
        for (int i = 0; i < angle_.size(); ++i)
            angle_[i] +=
                std::clamp(newest->target[i] - angle_[i], -servo_.slew_rad_per_s * dt, servo_.slew_rad_per_s * dt);
    }

    ServoModel servo_;
    Coordinates angle_;
    std::array<Pulse, 8> pulses_;
    std::size_t next_ = 0;
    double time_ = 0;
};

}  // namespace

std::unique_ptr<Driver> make_simulated_driver(const ServoModel& servo, const Coordinates& start) {
    return std::make_unique<SimulatedDriver>(servo, start);
}

}  // namespace palpate
