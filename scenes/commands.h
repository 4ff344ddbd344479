#pragma once
// The commands of the program, one file each. Each adds its options to the program and returns what to
// do when it is chosen; that returns the exit code.

#include <CLI/CLI.hpp>
#include <atomic>
#include <functional>

namespace palpate {

using Action = std::function<int()>;

Action add_run_command(CLI::App& program, const std::atomic<bool>& stop);
Action add_mesh_command(CLI::App& program);
Action add_device_command(CLI::App& program);
Action add_compare_command(CLI::App& program, const std::atomic<bool>& stop);
Action add_explain_command(CLI::App& program, const std::atomic<bool>& stop);
Action add_convert_command(CLI::App& program, const std::atomic<bool>& stop);
Action add_replay_command(CLI::App& program, const std::atomic<bool>& stop);
Action add_devices_command(CLI::App& program);
Action add_doctor_command(CLI::App& program);
Action add_home_command(CLI::App& program);
Action add_jog_command(CLI::App& program, const std::atomic<bool>& stop);
Action add_calibrate_thimble_command(CLI::App& program, const std::atomic<bool>& stop);
Action add_sweep_command(CLI::App& program, const std::atomic<bool>& stop);
Action add_stress_command(CLI::App& program, const std::atomic<bool>& stop);
Action add_indent_command(CLI::App& program);
Action add_calibrate_command(CLI::App& program, const std::atomic<bool>& stop);
Action add_tracker_command(CLI::App& program, const std::atomic<bool>& stop);
Action add_emulate_tracker_command(CLI::App& program, const std::atomic<bool>& stop);
Action add_view_command(CLI::App& program, const std::atomic<bool>& stop);

}  // namespace palpate
