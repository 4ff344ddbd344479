// The program. Exit codes: 0 done, 1 failure inside, 2 input that cannot be used.

#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>

#include "devices/drivers/last_resort.h"
#include "devices/loop/clock.h"
#include "engine/skin/solve/kernels.h"
#include "meshes/input_error.h"
#include "scenes/program/command_line.h"
#include "scenes/program/interruption.h"
#include "scenes/program/version.h"

namespace {

std::atomic<bool> stop_requested{false};
std::atomic<double> interrupted_at{0};
constexpr double one_press = 0.05;  ///< Ctrl-C may come twice for one, to a program and to its group [s]

/// The first asks for an orderly end. A second Ctrl-C waits for nothing but thimbles to be at rest.
extern "C" void request_stop(int signal) {
    palpate::end_if_at_once();
    stop_requested = true;
    if (signal != SIGINT) return;
    const double now = palpate::device_clock(), before = interrupted_at.exchange(now);
    if (before > 0 && now - before > one_press) palpate::rest_then_die(signal);
}

template <class Kernels>
int widest(const Kernels& kernels) {
    int width = 0;
    for (const auto& kernel : kernels) width = std::max(width, kernel.width);
    return width;
}

std::string version_text() {
    const palpate::KernelSet& kernels = palpate::best_kernels();
    const std::string commit = palpate::program_commit;
    return std::string("palpate ") + palpate::program_version + (commit.empty() ? "" : " (" + commit + ")") +
           "\nkernels for " + kernels.instructions + ": " + std::to_string(widest(kernels.for_double)) +
           " fingers side by side in double, " + std::to_string(widest(kernels.for_float)) + " in float";
}

palpate::Actions add_commands(const palpate::Command& commands) {
    palpate::Actions actions;
    actions["new"] = palpate::add_new_command(commands);
    actions["list"] = palpate::add_list_command(commands);
    actions["run"] = palpate::add_run_command(commands, stop_requested);
    actions["view"] = palpate::add_view_command(commands, stop_requested);
    actions["gallery"] = palpate::add_gallery_command(commands, stop_requested);
    actions["explain"] = palpate::add_explain_command(commands, stop_requested);
    actions["replay"] = palpate::add_replay_command(commands, stop_requested);
    actions["convert"] = palpate::add_convert_command(commands, stop_requested);
    actions["compare"] = palpate::add_compare_command(commands, stop_requested);
    actions["sweep"] = palpate::add_sweep_command(commands, stop_requested);
    actions["stress"] = palpate::add_stress_command(commands, stop_requested);
    actions["mesh"] = palpate::add_mesh_command(commands);
    actions["indent"] = palpate::add_indent_command(commands);
    actions["pressure"] = palpate::add_pressure_command(commands);
    actions["fit"] = palpate::add_fit_command(commands, stop_requested);
    actions["tracker"] = palpate::add_tracker_command(commands, stop_requested);
    actions["emulate-tracker"] = palpate::add_emulate_tracker_command(commands, stop_requested);
    actions["keys"] = palpate::add_keys_command(commands);
    actions["kinematics"] = palpate::add_kinematics_command(commands);
    actions["boards"] = palpate::add_boards_command(commands);
    actions["doctor"] = palpate::add_doctor_command(commands);
    actions["calibrate-thimble"] = palpate::add_calibrate_thimble_command(commands, stop_requested);
    actions["jog"] = palpate::add_jog_command(commands, stop_requested);
    actions["home"] = palpate::add_home_command(commands);
    actions["completion"] = palpate::add_completion_command(commands);
    actions["man"] = palpate::add_man_command(commands);
    return actions;
}

int run_program(int argc, char** argv) {
    for (int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) std::signal(signal, request_stop);
    std::signal(SIGPIPE, SIG_IGN);  // whoever read the output is gone: thimbles are still to be brought to rest
    std::signal(SIGXFSZ, SIG_IGN);  // a file that grows too large is an error like others
    try {
        return palpate::obey_command_line(argc, argv, version_text(), add_commands);
    } catch (const palpate::InputError& error) {
        for (const auto& message : error.messages) std::fprintf(stderr, "%s\n", message.c_str());
        return 2;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "palpate: %s\n", error.what());
        return 1;
    }
}

/// Whoever is to read standard output has gone (`| head`): that is their choice, and no failure.
bool reader_has_gone() {
    pollfd out{STDOUT_FILENO, POLLOUT, 0};
    return ::poll(&out, 1, 0) == 1 && (out.revents & (POLLERR | POLLHUP)) != 0;
}

/// The exit code, once all of standard output is written: what is lost there (a full disk) is said.
int end_output(int code) {
    errno = 0;
    const bool failed = std::fflush(stdout) != 0 || std::ferror(stdout);
    if (!failed || errno == EPIPE || reader_has_gone()) return code;
    // Where it failed before, nobody knows why any more: one more byte tells, at the end of what is broken anyway.
    const bool unknown = errno == 0 && ::write(STDOUT_FILENO, "\n", 1) == 1;
    std::fprintf(stderr, "standard output: %s\n", unknown ? "not all of it was written" : std::strerror(errno));
    return code == 0 ? 1 : code;
}

}  // namespace

int main(int argc, char** argv) { return end_output(run_program(argc, argv)); }
