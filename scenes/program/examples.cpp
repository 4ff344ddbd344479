// Examples of each command, as its --help and the manual show them; a test reads every one.

#include <array>

#include "scenes/program/command_table.h"

namespace palpate {

namespace {

struct Examples {
    const char *command, *lines;
};

constexpr std::array examples{
    Examples{"new",
             "palpate new mine.toml\n"
             "palpate new lift.toml --from grasp"},
    Examples{"list",
             "palpate list\n"
             "palpate list kinds"},
    Examples{"run",
             "palpate run scenes/hand.toml --report hand.html\n"
             "palpate run scenes/press.toml --set finger.index.material.young_kPa=40 --duration 0.3\n"
             "palpate run scenes/pinch.toml --video pinch.webm\n"
             "palpate run scenes/press.toml --stream udp:127.0.0.1:5006"},
    Examples{"gallery",
             "palpate gallery pinch mine.toml\n"
             "palpate gallery --out scenes/pictures/gallery\n"
             "palpate gallery --paper"},
    Examples{"view",
             "palpate view scenes/hand.toml\n"
             "palpate view scenes/recorded_hand.toml --tracker ultraleap"},
    Examples{"explain", "palpate explain scenes/press.toml --measure"},
    Examples{"replay",
             "palpate replay run.palpate\n"
             "palpate replay run.palpate --out results/again --report again.html"},
    Examples{"convert",
             "palpate convert run.palpate --csv tables\n"
             "palpate convert run.palpate --vtu pads --rate 100"},
    Examples{"compare",
             "palpate compare scenes/roll.toml\n"
             "palpate compare scenes/edge.toml --kinds chinello-3rrs,serial-5dof --methods constrained,force"},
    Examples{"sweep",
             "palpate sweep scenes/hand.toml\n"
             "palpate sweep scenes/ball.toml --axes dt_ms=1,5 solver.preset=fast,accurate finger.*.elements=200,800"},
    Examples{"stress",
             "palpate stress --short\n"
             "palpate stress --case S1,S6"},
    Examples{"mesh",
             "palpate mesh index --out pad.vtu\n"
             "palpate mesh scan.obj --elements 2000 --picture scan.svg"},
    Examples{"indent",
             "palpate indent index-median\n"
             "palpate indent thumb-large --angle 0,30 --elements 347,1000 --depth-mm 2"},
    Examples{"pressure",
             "palpate pressure maps/*.csv --first-cell 1,12 --angle 0,15,30    # which of these fits best\n"
             "palpate pressure maps/*.csv --first-cell 1,12 --finger mine.toml --out mine"},
    Examples{"fit", "palpate fit data.csv --finger index-median --fit young_kPa,low --out mine.toml"},
    Examples{"tracker",
             "palpate tracker ultraleap --seconds 10 --record hand.jsonl\n"
             "palpate tracker scenes/pinch.jsonl --pinch thumb,index --scene scenes/recorded_hand.toml"},
    Examples{"emulate-tracker", "palpate emulate-tracker scenes/pinch.jsonl --loop"},
    Examples{"keys",
             "palpate keys\n"
             "palpate keys finger.device\n"
             "palpate keys --json-schema > scene.schema.json"},
    Examples{"kinematics",
             "palpate kinematics chinello-3rrs --pose 8,-12,23.5\n"
             "palpate kinematics serial-5dof --workspace"},
    Examples{"boards",
             "palpate boards\n"
             "palpate boards --timing 10"},
    Examples{"doctor", "palpate doctor scenes/hand.toml --mend"},
    Examples{"calibrate-thimble", "palpate calibrate-thimble mine.toml --finger index --out index.toml"},
    Examples{"jog", "palpate jog mine.toml --finger index"},
    Examples{"home", "palpate home mine.toml"},
    Examples{"completion",
             "eval \"$(palpate completion bash)\"\n"
             "palpate completion zsh > ~/.zfunc/_palpate"},
    Examples{"man", "palpate man | man -l -"},
};

}  // namespace

std::string examples_of(const std::string& command) {
    for (const Examples& e : examples)
        if (e.command == command) return e.lines;
    return "";
}

}  // namespace palpate
