"""What programs rely on that were compiled earlier stays as it is: abi_test.py LIBRARY [--update]

Functions and callbacks with their parameters, constants, sizes and offsets of structs, as a C compiler sees palpate.h, against
abi.txt; SONAME and symbol versions of the library, too. What is new may come, at the end of structs; it is to be written down
(--update). Then it breaks the header in the ways in which headers are broken, and sees that each is found."""
import pathlib
import re
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
HEADER = HERE.parents[1] / "scenes/api/palpate.h"
GROWS = ("PALPATE_FIELD_COUNT", "PALPATE_API_VERSION")  # counts of what there is


def described(header):
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.S)
    lines, prints = [], []
    for declaration in re.findall(r"^PALPATE_API ([^;]+);", text, re.M):
        lines.append("function " + re.sub(r"\s+", " ", declaration.strip()))
    for callback, parameters in re.findall(r"^typedef void \(\*(\w+)\)\(([^;]+)\);", text, re.M):
        lines.append(f"callback {callback} ({parameters})")
    for constant in re.findall(r"^\s*(PALPATE_[A-Z0-9_]+) = ", text, re.M) + re.findall(r"enum \{ (PALPATE_\w+) = ", text):
        prints.append(f'printf("constant {constant} %d\\n", (int){constant});')
    for constant in re.findall(r", (PALPATE_[A-Z0-9_]+) = ", text) + re.findall(r"#define (PALPATE_\w+) \d", text):
        prints.append(f'printf("constant {constant} %d\\n", (int){constant});')
    for name, body in re.findall(r"typedef struct (\w+) \{(.*?)\} \w+;", text, re.S):
        prints.append(f'printf("struct {name} %d\\n", (int)sizeof(struct {name}));')
        for declaration in body.split(";"):
            for field in re.findall(r"(\w+)(?:\[\w+\])?\s*(?:,|$)", declaration.strip()):
                at = f"(int)offsetof(struct {name}, {field}), (int)sizeof(((struct {name}*)0)->{field})"
                prints.append(f'printf("field {name}.{field} at %d size %d\\n", {at});')
    with tempfile.TemporaryDirectory() as folder:
        source, program = pathlib.Path(folder) / "abi.c", pathlib.Path(folder) / "abi"
        source.write_text("#include <stddef.h>\n#include <stdio.h>\n" + text + "\nint main(void) {\n" + "\n".join(prints) + "\nreturn 0;\n}\n")
        subprocess.run(["cc", "-std=c99", "-pedantic", "-Wall", "-Werror", source, "-o", program], check=True)
        lines += subprocess.run([program], check=True, capture_output=True, text=True).stdout.splitlines()
    return sorted(set(lines))


def broken(before, now):
    """A struct may grow; what it had stays where it was."""
    sizes = {line.split()[1]: int(line.split()[2]) for line in now if line.startswith("struct ")}
    wrong = []
    for line in before:
        kind, name = line.split()[:2]
        if kind == "struct" and sizes.get(name, -1) >= int(line.split()[2]):
            continue
        if name not in GROWS and line not in now:
            wrong.append(f"no longer so: {line}")
    return wrong


def wrong_in(library, lines):
    dynamic = subprocess.run(["readelf", "-d", library], capture_output=True, text=True, check=True).stdout
    wrong = [] if "Library soname: [libpalpate.so.0]" in dynamic else ["the SONAME is not libpalpate.so.0: " + dynamic]
    symbols = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout
    shown = set(re.findall(r" T (\w+)@@PALPATE_0", symbols))
    names = {re.search(r"(palpate_\w+)\(", line)[1] for line in lines if line.startswith("function")}
    return wrong + [f"{name}@@PALPATE_0 is not in the library" for name in sorted(names - shown)]


BREAKS = {
    "a function is removed": (r"PALPATE_API int32_t palpate_step\([^;]+;", ""),
    "a parameter has another type": (r"palpate_step\(PalpateWorld world, int32_t n\)", "palpate_step(PalpateWorld world, int64_t n)"),
    "a callback has another parameter": (r"\(\*PalpateLog\)\(const char\* message", "(*PalpateLog)(int32_t level, const char* message"),
    "a constant has another value": (r"PALPATE_FORCES = 1,", "PALPATE_FORCES = 24,"),
    "a field comes between": (r"(typedef struct PalpateFingerState \{\s+int32_t size;)", r"\1 double early;"),
    "a field is wider": (r"(int32_t converged;[^\n]*\n\s+)int32_t iterations;", r"\1int64_t iterations;"),
    "a field is gone": (r"double spin\[3\];", ""),
    "fields change places": (r"(double velocity\[3\];)[^\n]*\n\s+(double spin\[3\];)", r"\2 \1"),
}

if __name__ == "__main__":
    header = HEADER.read_text()
    now, stored = described(header), HERE / "abi.txt"
    if "--update" in sys.argv:
        stored.write_text("\n".join(now) + "\n")
    before = stored.read_text().splitlines()
    wrong = broken(before, now) + wrong_in(sys.argv[1], before)
    wrong += [f"new: run abi_test.py LIBRARY --update, and look at what changes: {line}" for line in now if line not in before]
    for what, (pattern, instead) in BREAKS.items():
        other, count = re.subn(pattern, instead, header)
        if count != 1 or not broken(before, described(other)):
            wrong.append(f"not found where {what}")
    grown = header.replace("int64_t resets; /* times", "int64_t resets; double late; /* times")
    if grown == header or broken(before, described(grown)):
        wrong.append("a struct may grow at its end")
    if not wrong_in(sys.argv[1], ["function int32_t palpate_gone(void)"]):
        wrong.append("not found where the library lacks a function")
    print("\n".join(wrong) if wrong else f"{len(before)} lines hold")
    sys.exit(1 if wrong else 0)
