"""abidiff, where it is installed, holds palpate.h against the dump of it that is stored: abidiff_test.py [--update]

The header with empty functions is compiled with debug information, so that libpalpate.so needs none; abi_test.py sees that
the library shows these functions. Then the header is broken, and abidiff has to say so. Exit code 77: there is no abidiff, or no x86-64."""
import pathlib
import platform
import re
import shutil
import subprocess
import sys
import tempfile

from abi_test import BREAKS, HEADER, HERE

STORED = HERE / "palpate.abi"


def compiled(header, folder):
    """A library that has what the header declares, without anything inside."""
    library, source = folder / "libpalpate.so", folder / "palpate.c"
    empty = re.sub(r"^(PALPATE_API [^;]+);", r"\1 { return 0; }", header, flags=re.M)
    source.write_text(re.sub(r"^(PALPATE_API void [^;{]+)\{ return 0; \}", r"\1{}", empty, flags=re.M))
    subprocess.run(["cc", "-std=c99", "-g", "-w", "-shared", "-fPIC", "-Wl,-soname,libpalpate.so.0", "-o", library, source], check=True)
    return library


def dump(library, out):
    subprocess.run(["abidw", "--no-show-locs", "--no-corpus-path", "--no-comp-dir-path", "--out-file", out, library], check=True)
    out.write_text(re.sub(r" path='[^']*'", "", out.read_text()))


def changes(library):
    """What abidiff says; nothing where all is as it was."""
    run = subprocess.run(["abidiff", STORED, library], capture_output=True, text=True)
    return (run.stdout + run.stderr).strip() if run.returncode else ""


if __name__ == "__main__":
    if not shutil.which("abidiff") or platform.machine() != "x86_64":
        print("abidiff is not installed (Debian's abigail-tools), or the dump is of another architecture")
        sys.exit(77)
    header, wrong = HEADER.read_text(), []
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        library = compiled(header, folder)
        if "--update" in sys.argv:
            dump(library, STORED)
        if said := changes(library):
            wrong.append(f"look at what changed, and run abidiff_test.py --update where it may:\n{said}")
        for what, (pattern, instead) in BREAKS.items():
            # An enumerator of no name is no part of what a compiled program sees; abi_test.py holds its value.
            if what != "a constant has another value" and not changes(compiled(re.sub(pattern, instead, header), folder)):
                wrong.append(f"abidiff says nothing where {what}")
    print("\n".join(wrong) if wrong else "abidiff finds no change, and each of those that were made")
    sys.exit(1 if wrong else 0)
