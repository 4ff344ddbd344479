"""Everything the READMEs say that can be tried is tried.

docs_test.py PROGRAM PART, where PART is
  links      links, pictures and anchors exist; README.md is short and names every command
  commands   commands, options and files of all shell lines and of all examples in --help exist
  snippets   scenes and finger files load; Python runs; C compiles; JSON has the keys of what it stands for
  run        shell lines that are marked neither "not run" nor "slow" end well
  slow       those that are marked "slow", if PALPATE_DOCS_SLOW is set
"""
import functools
import json
import os
import pathlib
import re
import shlex
import shutil
import socket
import subprocess
import sys
import tempfile
import time

import readmes
from readmes import ROOT

PROGRAM = pathlib.Path(sys.argv[1]).resolve()
problems = []


def check(condition, message):
    if not condition:
        problems.append(message)


def program(*arguments, **options):
    return subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, timeout=600, **options)


# --- what there is, as the program says it itself -------------------------------------------------------------------


@functools.cache
def commands_of_program():
    listed = program("--help").stdout.split("Subcommands:")[1].split("\n\n")[0]
    return re.findall(r"^  ([a-z][a-z-]*)", listed, flags=re.M)


@functools.cache
def help_of(command):
    shown = program(command, "--help")
    assert shown.returncode == 0, command
    return shown.stdout


def options_of(command):
    return set(re.findall(r"^  (?:-\w,)?(--[\w-]+)", help_of(command), flags=re.M))


# --- parts ------------------------------------------------------------------------------------------------------------


def links():
    for file in readmes.readmes():
        for target in re.findall(r"\]\(([^)\s]+)\)", readmes.prose(file)):
            if target.startswith(("http://", "https://")):
                continue
            path, _, anchor = target.partition("#")
            other = (file.parent / path).resolve() if path else file
            check(other.exists(), f"{file.relative_to(ROOT)}: {target}: no such file")
            if anchor and other.suffix == ".md" and other.exists():
                check(anchor in readmes.anchors(other), f"{file.relative_to(ROOT)}: {target}: no such heading")
        for path in re.findall(r"`((?:scenes|engine|devices|meshes|bench|tests|\.ci)/[\w./-]+)`", readmes.prose(file)):
            check((ROOT / path).exists(), f"{file.relative_to(ROOT)}: {path}: no such file")
        for suite, name in re.findall(r"`([A-Z]\w+)\.([A-Z]\w+|\*)`", readmes.prose(file)):
            defined = re.compile(rf"TEST(_F|_P)?\({suite}, {'' if name == '*' else name + chr(92) + ')'}")
            found = any(defined.search(f.read_text()) for f in ROOT.glob("tests/*/*_test.cpp"))
            check(found, f"{file.relative_to(ROOT)}: there is no test {suite}.{name}")
    # Clocks that jump: everything is timed by one that does not (devices/README.md, what is promised).
    for source in [f for part in ("devices", "engine", "scenes") for f in ROOT.glob(f"{part}/**/*.[ch]*")]:
        if source.suffix in (".h", ".cpp"):
            jumps = re.search(r"system_clock|CLOCK_REALTIME|gettimeofday|high_resolution_clock", source.read_text())
            check(not jumps, f"{source.relative_to(ROOT)}: {jumps and jumps[0]} reads a clock that may jump")
    front = ROOT / "README.md"
    check(len(front.read_text().splitlines()) <= 180, "README.md: more than 180 lines")
    table = front.read_text().split("## Commands")[1].split("\n## ")[0]
    named = set(re.findall(r"^\| `([a-z-]+)", table, flags=re.M))
    for command in commands_of_program():
        check(command in named, f"README.md: no row for `palpate {command}` in its table of commands")
    for command in named - set(commands_of_program()):
        check(False, f"README.md: there is no `palpate {command}`")


def words_of(command):
    """Its words up to a pipe; placeholders in capitals stay as they are."""
    words = shlex.split(command, comments=True)
    return words[: words.index("|")] if "|" in words else words


def check_palpate_line(where, words):
    words = words[words.index("palpate") :]
    if len(words) == 1:
        return
    command, known = words[1], commands_of_program()
    if command.startswith("-"):
        return check(command in {"--help", "--version"}, f"{where}: no option {command}")
    if command in ("COMMAND", "..."):
        return
    if command not in known:
        return check(False, f"{where}: no command '{command}'")
    options = options_of(command)
    for word in words[2:]:
        if word.startswith("--"):
            check(word.split("=")[0] in options, f"{where}: {command} has no option {word}")
    for word in words[2:]:
        if re.fullmatch(r"(scenes|meshes)/[\w./-]+", word):
            check((ROOT / word).exists(), f"{where}: {word}: no such file")


def check_line(where, line):
    quoted = re.search(r"\$\((.*?)\)", line)
    words = words_of(quoted[1] if quoted else line)
    if "palpate" in words:
        check_palpate_line(where, words)
    for script in re.findall(r"\bsh ([\w/]+\.sh)", line):
        check((ROOT / script).is_file(), f"{where}: {script}: no such file")
    for target in re.findall(r"build/release/(?:tests/)?([\w-]+)", line):
        defined = any(re.search(rf"\b{target}\b", f.read_text()) for f in ROOT.glob("*/CMakeLists.txt"))
        check(defined or target == "release", f"{where}: nothing builds {target}")


def commands():
    lines = 0
    for block in readmes.all_blocks("sh"):
        for number, line in readmes.shell_commands(block):
            check_line(f"{block.file.relative_to(ROOT)}:{number}", line)
            lines += 1
    assert lines > 30, "hardly any command was found"
    # Commands within sentences.
    for file in readmes.readmes():
        for code in re.findall(r"`(palpate [^`]+)`", readmes.prose(file).replace("\n", " ")):
            check_line(str(file.relative_to(ROOT)), code.replace("[", "").replace("]", ""))
    for command in commands_of_program():
        shown = help_of(command)
        check("Examples:" in shown, f"palpate {command} --help: no example")
        for line in shown.split("Examples:")[-1].strip().splitlines():
            check_line(f"palpate {command} --help", line.strip())


def merged(into, other):
    """Tables joined key by key; what belongs to the last table of an array ([finger.device]) goes there."""
    for key, value in other.items():
        if isinstance(value, dict) and isinstance(into.get(key), list):
            merged(into[key][-1], value)
        elif isinstance(value, dict) and isinstance(into.get(key), dict):
            merged(into[key], value)
        elif key == "finger" and isinstance(value, list) and into.get(key):
            merged(into[key][-1], value[0])  # the scene's own finger, changed
        elif isinstance(value, list) and value and isinstance(value[0], dict) and key in ("object", "friction"):
            into[key] = into.get(key, []) + value
        else:
            into[key] = value
    return into


def toml_text(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {toml_text(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml_text, value)) + "]"
    return json.dumps(value)


def load_toml_block(folder, block):
    import tomllib

    name = f"block{block.line}.toml"
    try:
        table = tomllib.loads(block.text)
    except tomllib.TOMLDecodeError as error:
        return check(False, f"{block}: {error}")
    if block.mark == "not loaded":
        return None
    if block.mark == "file":
        return (folder / block.mark_value).write_text(block.text)  # read by whoever names it
    if "duration_s" in table and "finger" in table:
        (folder / name).write_text(block.text)  # as it stands, so that the lines of messages are right
    else:
        base = ROOT / (block.mark_value if block.mark == "with" else "scenes/press.toml")
        scene = merged(tomllib.loads(base.read_text()), table)
        for o in scene.get("object", []):
            if "file" in o:
                o["file"] = str(base.parent / o["file"])
        (folder / name).write_text("".join(f"{k} = {toml_text(v)}\n" for k, v in scene.items()))
    ran = program("explain", name, cwd=folder)
    check(ran.returncode == 0, f"{block}: {ran.stdout}{ran.stderr}")


def laps_of_sender(block, folder):
    """Runs a sender of hands against a port, without waiting between frames, until it has begun again twice."""
    frames = len((ROOT / "scenes/pinch.jsonl").read_text().splitlines()) - 1
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.bind(("127.0.0.1", 0))
    receiver.settimeout(30)
    text = block.text.replace("5005", str(receiver.getsockname()[1]))
    assert "time.sleep(" in text
    text = re.sub(r"time\.sleep\([^)]*\)", "time.sleep(0.001)", text)
    sender = subprocess.Popen([sys.executable, "-c", text], cwd=ROOT, stderr=subprocess.PIPE, text=True)
    received = 0
    try:
        while received < 2 * frames + 5 and sender.poll() is None:
            joints = json.loads(receiver.recv(65536))["joints"]
            received += len(joints) == 26
    except socket.timeout:
        pass
    finally:
        if sender.poll() is None:
            sender.kill()
            sender.wait()
        else:
            check(False, f"{block}: {sender.stderr.read()}")
    # Datagrams may be lost, but not half of two laps.
    check(received > frames, f"{block}: {received} frames of {2 * frames} arrived")


def python_with_numpy():
    """Debian's has it, where python3-numpy is installed; None: nobody's."""
    for python in ("/usr/bin/python3", sys.executable):
        if subprocess.run([python, "-c", "import numpy"], capture_output=True).returncode == 0:
            return python
    return None


def with_package():
    """Where `import palpate` finds the package of this checkout, and the library of this build."""
    return dict(os.environ, PYTHONPATH=str(ROOT / "scenes/api/python"), PYTHONDONTWRITEBYTECODE="1",
                PALPATE_LIBRARY=str(PROGRAM.parent / "libpalpate.so.0"))  # fmt: skip


def client_of_stream(block):
    """Runs a client of `palpate run --stream udp:127.0.0.1:5006` beside a scene; it must hear of it, and be heard."""
    probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    probe.bind(("127.0.0.1", 0))
    port = str(probe.getsockname()[1])
    probe.close()
    assert "5006" in block.text
    client = subprocess.Popen([sys.executable, "-u", "-c", block.text.replace("5006", port)], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True)  # fmt: skip
    try:
        time.sleep(0.5)
        with tempfile.TemporaryDirectory() as out:
            ran = program("run", str(ROOT / "scenes/press.toml"), "--set", "dt_ms=1", "--no-picture", "--duration", "2", "--out", out + "/results",
                          "--stream", "udp:127.0.0.1:" + port)  # fmt: skip
    finally:
        client.kill()
        heard, complaints = client.communicate()
    told = re.search(r"stream: (\d+) of (\d+) steps sent, .*; (\d+) commands, 0 that", ran.stdout)
    check(told and int(told[1]) > 20 and int(told[3]) > 20, f"{block}: {ran.stdout[-600:]}{ran.stderr}")
    check(len(heard.splitlines()) > 20, f"{block}: heard {heard}{complaints}")


def keys_of(value):
    if isinstance(value, dict):
        return {k: keys_of(v) for k, v in value.items()}
    return keys_of(value[0]) if isinstance(value, list) and value else None


def check_stream_schema(block):
    ran = program("run", str(ROOT / "scenes/press.toml"), "--no-picture", "--duration", "0.02", "--stream", "-", "--stream-samples", "--out", "")
    real, said = json.loads(ran.stdout.splitlines()[0]), json.loads(block.text)
    check(keys_of(real) == keys_of(said), f"{block}: the stream has other keys: {ran.stdout[:600]}")
    check(real["palpate"] == said["palpate"], f"{block}: another version of the schema")


def check_languages():
    """Blocks in C, JSON, and Python that uses the package."""
    for block in readmes.all_blocks("c"):
        if shutil.which("cc"):
            ran = subprocess.run(["cc", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-x", "c",
                                  "-I", PROGRAM.parent / "api", "-"], input=block.text, capture_output=True, text=True)  # fmt: skip
            check(ran.returncode == 0, f"{block}: {ran.stderr}")
    for block in readmes.all_blocks("json"):
        check_stream_schema(block)
    python = python_with_numpy()
    for block in readmes.all_blocks("python"):
        if "import palpate" in block.text and python:
            ran = subprocess.run([python, "-c", block.text], cwd=ROOT, env=with_package(), capture_output=True, text=True)
            check(ran.returncode == 0, f"{block}: {ran.stdout}{ran.stderr}")


def snippets():
    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(scratch)
        tomls = readmes.all_blocks("toml")
        assert len(tomls) > 5, "hardly any scene was found"
        for block in sorted(tomls, key=lambda b: b.mark != "file"):
            load_toml_block(folder, block)
        for block in tomls:
            if block.mark == "file" and "servo" not in block.text:
                ran = program("indent", block.mark_value, "--depth-mm", "0.2", "--steps", "2", "--out", "", cwd=folder)
                check(ran.returncode == 0, f"{block}: {ran.stdout}{ran.stderr}")
    pythons = readmes.all_blocks("python")
    assert pythons
    for block in pythons:
        compile(block.text, str(block), "exec")
        if "recvfrom" in block.text:
            client_of_stream(block)
        elif "while True" in block.text:
            laps_of_sender(block, ROOT)
    check_languages()


def same_words(printed, said):
    """Lines as words; numbers may be a tenth off, as compilers and processors may have it."""
    printed, said = printed.split(), said.split()
    if len(printed) != len(said):
        return False
    for p, s in zip(printed, said):
        try:
            if abs(float(p) - float(s)) > 0.1 * abs(float(s)) + 1e-3:
                return False
        except ValueError:
            if p != s:
                return False
    return True


def check_output(block, printed):
    for line in block.text.splitlines():
        found = any(same_words(p, line) for p in printed.splitlines())
        check(found, f"{block}: this is not printed: {line}")


def run(slow=False):
    """Shell lines, one after the other, in a folder that looks like the checkout; those of a page share it."""
    ran_any, python = False, python_with_numpy()
    cache = tempfile.TemporaryDirectory()  # of meshes
    for file in readmes.readmes():
        with tempfile.TemporaryDirectory() as scratch:
            folder = pathlib.Path(scratch)
            for name in os.listdir(ROOT):
                if name not in ("build", "results", ".git"):
                    (folder / name).symlink_to(ROOT / name)
            (folder / "build").mkdir()
            (folder / "build/release").symlink_to(PROGRAM.parent)
            printed = ""  # by the shell block before; empty: it was not run
            for block in readmes.blocks(file):
                if block.mark == "file":
                    (folder / block.mark_value).write_text(block.text)
                if block.mark == "output" and printed:
                    check_output(block, printed)
                if block.language == "sh":
                    printed = ""
                if block.language != "sh" or block.mark == "not run" or (block.mark == "slow") != slow:
                    continue
                for number, line in readmes.shell_commands(block):
                    if "mpirun" in line and not shutil.which("mpirun"):
                        continue
                    if "python3 " in line and not python:
                        continue
                    first = f"{PROGRAM.parent}:{pathlib.Path(python or '').parent}"
                    environment = dict(os.environ, PATH=f"{first}:{os.environ['PATH']}", PYTHONDONTWRITEBYTECODE="1",
                                       XDG_CACHE_HOME=cache.name)  # fmt: skip
                    ran = subprocess.run(["bash", "-c", line], cwd=folder, env=environment, capture_output=True,
                                         text=True, stdin=subprocess.DEVNULL)  # fmt: skip
                    printed += ran.stdout
                    ran_any = True
                    check(ran.returncode == 0, f"{file.relative_to(ROOT)}:{number}: {line}\n{ran.stdout}{ran.stderr}")
    assert ran_any


if sys.argv[2] == "slow" and not os.environ.get("PALPATE_DOCS_SLOW"):
    print("skipped: PALPATE_DOCS_SLOW=1 runs them (minutes to an hour)")
    sys.exit(77)
parts = {"links": links, "commands": commands, "snippets": snippets, "run": run, "slow": lambda: run(slow=True)}
parts[sys.argv[2]]()
print("\n".join(problems))
sys.exit(1 if problems else 0)
