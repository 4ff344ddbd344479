"""One scene, the same bits from all: same_bits.py PROGRAM LIBRARY BUILD

The program's live stream, its recording replayed, a program in C, Python, one in C# (where mono is), and a world that gets
the stream's poses: after every step forces, torques and poses of fingers and objects (one of them soft) and joint angles are the same, bit for bit."""
import json
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM, LIBRARY, BUILD = sys.argv[1:]
os.environ["PALPATE_LIBRARY"] = LIBRARY
sys.path.insert(0, str(ROOT / "scenes/api/python"))
sys.dont_write_bytecode = True
import palpate  # noqa: E402

STEPS = 30  # fewer than the stream's ring holds: none is left out, however busy the machine is
SCENE = """
duration_s = 0.06
dt_ms = 2
[solver]
preset = "balanced"
[[object]]
name = "table"
kind = "plane"
friction = 0.5
[[object]]
name = "ball"
kind = "sphere"
radius_mm = 8
position_mm = [40, 0, 8]
mass_g = 4
friction = 0.5
[[object]]
name = "cushion"
kind = "sphere"
radius_mm = 8
position_mm = [-50, 0, -4]
friction = 0.5
soft = { young_kPa = 10, elements = 200, fixed = "bottom", fixed_mm = 3 }
[[finger]]
name = "index"
elements = 150
device = { kind = "chinello-3rrs" }
track = [ { t_s = 0, position_mm = [0, 0, 8.5] }, { t_s = 0.03, position_mm = [1, 0, 6.2] } ]
[[finger]]
name = "thumb"
elements = 150
track = [ { t_s = 0, position_mm = [40, 0, 25] }, { t_s = 0.03, position_mm = [40, 1, 22] } ]
[[finger]]
name = "middle"
elements = 150
track = [ { t_s = 0, position_mm = [-50, 0, 12.5] }, { t_s = 0.03, position_mm = [-50, 0, 10] } ]
"""


def bits(step, *numbers):
    return " ".join([str(step), *(struct.pack(">d", x).hex() for part in numbers for x in part)])


def of_world(step, world):
    parts = [world.forces, world.torques, world.bones, world.object_poses, world.object_forces, world.thimbles[0].sent]
    return bits(step, *(part.reshape(-1).tolist() for part in parts))


def of_line(line):
    fingers, objects = line["fingers"], line["objects"]
    rows = lambda key, all: [x for one in all for x in one[key]]  # noqa: E731
    return bits(line["step"], rows("force", fingers), rows("torque", fingers), rows("pose", fingers), rows("pose", objects),
                rows("force", objects), fingers[0]["thimble"]["sent"])  # fmt: skip


def stepped(world, before=lambda k: None):
    lines = []
    for k in range(STEPS):
        before(k)
        world.step()
        lines.append(of_world(k + 1, world))
    return lines


def run(*command, **more):
    return subprocess.run([str(c) for c in command], check=True, stdout=subprocess.PIPE, text=True, **more).stdout.splitlines()


with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    scene, recording = folder / "scene.toml", folder / "run.palpate"
    scene.write_text(SCENE)
    stream = [json.loads(line) for line in run(PROGRAM, "run", scene, "--no-picture", "--stream", "-", "--record", recording, "--out", folder / "out")]
    results = {"the program's stream": [of_line(line) for line in stream]}
    results["its recording, replayed"] = stepped(palpate.replay(recording))
    results["Python"] = stepped(palpate.load(scene))
    again = palpate.load(scene)

    def told(k):
        for finger in stream[k]["fingers"]:
            again.fingers[finger["name"]].pose = finger["tracked"]

    results["the stream's poses, set"] = stepped(again, told)
    where = pathlib.Path(LIBRARY).parent
    run("cc", "-std=c99", "-pedantic", "-Wall", "-Werror", f"-I{BUILD}/api", ROOT / "tests/api/bits.c", LIBRARY, f"-Wl,-rpath,{where}",
        "-o", folder / "bits")  # fmt: skip
    results["C"] = run(folder / "bits", scene, STEPS)
    if shutil.which("mcs") and shutil.which("mono"):
        sources = [*sorted((ROOT / "scenes/api/unity/Runtime").glob("*.cs")), ROOT / "tests/api/Bits.cs", ROOT / "tests/api/UnityStub.cs"]
        run("mcs", "-langversion:6", f"-out:{folder}/Bits.exe", *sources)
        results["C#"] = run("mono", folder / "Bits.exe", "print", scene, STEPS, env={**os.environ, "LD_LIBRARY_PATH": str(where)})
    run(PROGRAM, "replay", recording)

expected = results.pop("Python")
wrong = [name for name, lines in results.items() if lines != expected]
for name in wrong:
    at = next((k for k, line in enumerate(results[name]) if k >= len(expected) or line != expected[k]), len(results[name]))
    print(f"{name}: {len(results[name])} lines, other bits from step {at + 1} on")
touched = sum("0000000000000000" not in line.split()[3] for line in expected)  # force along z of the first finger
print(f"{STEPS} steps, {touched} with contact, the same bits from Python, " + ", ".join(set(results) - set(wrong)))
sys.exit(bool(wrong) or len(expected) != STEPS or touched < 5)
