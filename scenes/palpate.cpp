// The program. Exit codes: 0 done, 1 failure inside, 2 input that cannot be used.

#include <csignal>
#include <cstdio>
#include <map>

#include "meshes/input_error.h"
#include "scenes/commands.h"

namespace {

std::atomic<bool> stop_requested{false};
extern "C" void request_stop(int) { stop_requested = true; }

}  // namespace

int main(int argc, char** argv) {
    std::signal(SIGINT, request_stop);
    std::signal(SIGTERM, request_stop);
    CLI::App program{"palpate: feel virtual objects with several fingers at once", "palpate"};
    program.require_subcommand(1);
    program.set_version_flag("--version", PALPATE_VERSION);
    std::map<std::string, palpate::Action> actions;
    actions["run"] = palpate::add_run_command(program, stop_requested);
    actions["mesh"] = palpate::add_mesh_command(program);
    actions["device"] = palpate::add_device_command(program);
    actions["compare"] = palpate::add_compare_command(program, stop_requested);
    actions["replay"] = palpate::add_replay_command(program, stop_requested);
    actions["convert"] = palpate::add_convert_command(program, stop_requested);
    actions["view"] = palpate::add_view_command(program, stop_requested);
    actions["devices"] = palpate::add_devices_command(program);
    actions["doctor"] = palpate::add_doctor_command(program);
    actions["home"] = palpate::add_home_command(program);
    actions["jog"] = palpate::add_jog_command(program, stop_requested);
    actions["calibrate-thimble"] = palpate::add_calibrate_thimble_command(program, stop_requested);
    actions["sweep"] = palpate::add_sweep_command(program, stop_requested);
    actions["stress"] = palpate::add_stress_command(program, stop_requested);
    actions["indent"] = palpate::add_indent_command(program);
    actions["calibrate"] = palpate::add_calibrate_command(program, stop_requested);
    actions["tracker"] = palpate::add_tracker_command(program, stop_requested);
    actions["emulate-tracker"] = palpate::add_emulate_tracker_command(program, stop_requested);
    actions["explain"] = palpate::add_explain_command(program, stop_requested);
    try {
        program.parse(argc, argv);
        return actions.at(program.get_subcommands().front()->get_name())();
    } catch (const CLI::ParseError& error) {
        return program.exit(error) == 0 ? 0 : 2;
    } catch (const palpate::InputError& error) {
        for (const auto& message : error.messages) std::fprintf(stderr, "%s\n", message.c_str());
        return 2;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "palpate: %s\n", error.what());
        return 1;
    }
}
