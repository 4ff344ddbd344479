#pragma once
// The commands of the program, one file each. Each adds its options to the program and returns what to
// do when it is chosen; that returns the exit code.

#include <atomic>
#include <functional>
#include <memory>

#include "scenes/program/options.h"

namespace palpate {

using Action = std::function<int()>;

Action add_new_command(const Command& program);
Action add_list_command(const Command& program);
Action add_completion_command(const Command& program);
Action add_man_command(const Command& program);
Action add_run_command(const Command& program, const std::atomic<bool>& stop);
Action add_gallery_command(const Command& program, const std::atomic<bool>& stop);
Action add_mesh_command(const Command& program);
Action add_kinematics_command(const Command& program);
Action add_compare_command(const Command& program, const std::atomic<bool>& stop);
Action add_explain_command(const Command& program, const std::atomic<bool>& stop);
Action add_convert_command(const Command& program, const std::atomic<bool>& stop);
Action add_replay_command(const Command& program, const std::atomic<bool>& stop);
Action add_boards_command(const Command& program);
Action add_doctor_command(const Command& program);
Action add_home_command(const Command& program);
Action add_jog_command(const Command& program, const std::atomic<bool>& stop);
Action add_calibrate_thimble_command(const Command& program, const std::atomic<bool>& stop);
Action add_sweep_command(const Command& program, const std::atomic<bool>& stop);
Action add_stress_command(const Command& program, const std::atomic<bool>& stop);
Action add_indent_command(const Command& program);
Action add_pressure_command(const Command& program);
Action add_fit_command(const Command& program, const std::atomic<bool>& stop);
Action add_tracker_command(const Command& program, const std::atomic<bool>& stop);
Action add_emulate_tracker_command(const Command& program, const std::atomic<bool>& stop);
Action add_keys_command(const Command& program);
Action add_view_command(const Command& program, const std::atomic<bool>& stop);

}  // namespace palpate
