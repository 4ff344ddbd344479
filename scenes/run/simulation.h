#pragma once
// A scene being run: world, device loops, recorded series.

#include <atomic>
#include <functional>
#include <memory>
#include <optional>

#include "engine/step.h"
#include "scenes/load/presets.h"
#include "scenes/load/scene.h"
#include "scenes/run/detail_count.h"
#include "scenes/run/fixed_skin.h"
#include "scenes/run/series.h"
#include "scenes/run/wrench_reserve.h"
#include "scenes/trackers/hand_source.h"

namespace palpate {

struct Hardware;

/// Keeps steps in real time.
struct RealTimePace {
    double due = 0;               ///< when the next step is [s of device_clock]
    std::int64_t late_steps = 0;  ///< that began more than 200 ms late
};

/// How a finger held a body when fingers alone held it last; not as it let go, with less than half its mean grip.
struct LastGrip {
    std::vector<GripSample> samples;
    double grip_sum = 0;         ///< of settled steps in which fingers alone hold the body [N]
    std::int64_t steps = 0;      ///< those
    std::int64_t touching = 0;   ///< and those of them in which this finger touches it
    std::int64_t unsettled = 0;  ///< steps of the hold that ended too far from balance to say anything
    double friction_use = 0;     ///< worst share of the Coulomb limit in use in settled steps
    std::vector<Vec3<double>>
        before;                  ///< [sample] where they were in the last step while they touched, body's frame [m]
    Vec3<double> slid{0, 0, 0};  ///< way over the body since fingers alone hold it, its frame [m]
};

/// What happened to a finger's solves so far.
struct FingerCounts {
    std::int64_t resets = 0;            ///< times it diverged and was reset
    std::int64_t wrong_side_steps = 0;  ///< steps in which an object pressed on a node from inside the skin
    std::int64_t extended_steps = 0;    ///< steps that were given more iterations than their budget
    std::int64_t cut_short_steps = 0;   ///< steps that the deadline ended before they had converged
    std::int64_t uphill_steps = 0;      ///< Newton steps that no halving brought to lower energy, taken back
};

struct Simulation {
    Simulation();
    ~Simulation();
    Simulation(Simulation&&) noexcept;
    Simulation& operator=(Simulation&&) noexcept;
    Scene scene;
    World world;
    std::unique_ptr<Threads> threads;
    std::vector<EntityId> fingers;                    ///< in the scene's order
    std::vector<std::unique_ptr<ThimbleLoop>> loops;  ///< per thimble
    std::vector<Series> finger_series;                ///< one row per step
    std::vector<FingerCounts> finger_counts;          ///< per finger
    std::vector<FixedSkin> fixed_skins;               ///< per finger
    std::vector<Series> body_series;                  ///< per body, one row per step (grasp.h)
    std::vector<Series> soft_series;                  ///< per object of tissue, one row per step (soft_series.h)
    std::vector<LastGrip> last_grips;                 ///< per body and finger
    DetailCount detail;                               ///< what was left out so far
    Series step_series;                               ///< wall time per system, one row per step
    std::unique_ptr<Hardware> hardware;               ///< null: thimbles tick in simulated time
    std::shared_ptr<LiveHands> live;                  ///< hands that fingers follow now; null: the scene's recording
    std::optional<RealTimePace> pace;                 ///< absent: as fast as it goes
    std::optional<Governor> governor;                 ///< absent: the scene's settings in every step
    bool keeps_series = true;                         ///< false: series stay empty, and steps allocate nothing
};

/// Threads: 0 = as many as the machine has.
Simulation make_simulation(Scene scene, int threads, bool keeps_series = true);

/// What goes into a step from outside.
struct StepInputs {
    std::vector<TrackerPose::Sample> fingers;  ///< per finger
    std::vector<Pose<double>> objects;         ///< per object, fixed ones too
    int preset = -1;                           ///< the governor's; -1: it has none
    std::optional<std::vector<int>> cuts{};    ///< of a recorded step (StepDeadline::given); absent: the clock's
};
/// Of the next step, from scripts, recordings and live hands.
StepInputs next_inputs(const Simulation& simulation);
/// The same into memory that is there.
void next_inputs(const Simulation& simulation, StepInputs& inputs);

/// One step: inputs in, world stepped, device loops ticked, one row recorded.
void advance(Simulation& simulation, const StepInputs& inputs);
void advance(Simulation& simulation);

/// From now on fingers that follow a hand follow live ones, in real time. Throws InputError where no finger follows
/// one.
void follow_live(Simulation& simulation, std::shared_ptr<LiveHands> live);

/// Runs to the scene's end or until `stop`; calls before_step(inputs), which may change them, before each step, and
/// after_step(inputs, share done) after it.
void run(Simulation& simulation, const std::atomic<bool>& stop,
         const std::function<void(const StepInputs&, double)>& after_step,
         const std::function<void(StepInputs&)>& before_step = {});

}  // namespace palpate
