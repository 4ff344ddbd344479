"""What programs rely on that were compiled earlier stays as it is: abi_test.py LIBRARY [--update]

Functions with their parameters, constants, sizes and offsets of structs, as a C compiler sees palpate.h, against abi.txt.
What is new may come, at the end of structs; it is to be written down (--update). SONAME and symbol version, too."""
import pathlib
import re
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
HEADER = HERE.parents[1] / "scenes/api/palpate.h"


def described():
    text = re.sub(r"/\*.*?\*/", "", HEADER.read_text(), flags=re.S)
    lines, prints = [], []
    for declaration in re.findall(r"^PALPATE_API ([^;]+);", text, re.M):
        lines.append("function " + re.sub(r"\s+", " ", declaration.strip()))
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
        source.write_text(f'#include <stddef.h>\n#include <stdio.h>\n#include "{HEADER}"\nint main(void) {{\n' + "\n".join(prints) + "\nreturn 0;\n}\n")
        subprocess.run(["cc", "-std=c99", "-pedantic", "-Wall", "-Werror", source, "-o", program], check=True)
        lines += subprocess.run([program], check=True, capture_output=True, text=True).stdout.splitlines()
    return sorted(set(lines))


def wrong_in(library):
    dynamic = subprocess.run(["readelf", "-d", library], capture_output=True, text=True, check=True).stdout
    wrong = [] if "Library soname: [libpalpate.so.0]" in dynamic else ["the SONAME is not libpalpate.so.0: " + dynamic]
    symbols = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout
    shown = set(re.findall(r" T (\w+)@@PALPATE_0", symbols))
    for line in (HERE / "abi.txt").read_text().splitlines():
        name = re.search(r"(palpate_\w+)\(", line)
        if line.startswith("function") and name[1] not in shown:
            wrong.append(f"{name[1]}@@PALPATE_0 is not in the library")
    return wrong


if __name__ == "__main__":
    now = described()
    stored = HERE / "abi.txt"
    if "--update" in sys.argv:
        stored.write_text("\n".join(now) + "\n")
    before = stored.read_text().splitlines()
    # A struct may grow; what it had stays where it was. Counts of what there is may grow, too.
    sizes = {line.split()[1]: int(line.split()[2]) for line in now if line.startswith("struct ")}
    wrong = []
    for line in before:
        kind, name = line.split()[:2]
        if kind == "struct" and sizes.get(name, -1) >= int(line.split()[2]):
            continue
        if name in ("PALPATE_FIELD_COUNT", "PALPATE_API_VERSION") or line in now:
            continue
        wrong.append(f"no longer so: {line}")
    wrong += [f"new: run abi_test.py LIBRARY --update, and look at what changes: {line}" for line in now if line not in before]
    wrong += wrong_in(sys.argv[1])
    print("\n".join(wrong) if wrong else f"{len(before)} lines hold")
    sys.exit(1 if wrong else 0)
