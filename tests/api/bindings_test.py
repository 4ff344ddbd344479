"""Python and C# against palpate.h: every function is bound, every struct lies as C has it, the stub says what the package has,
and Unity's sample refers to scripts and fields that are there. bindings_test.py (with PYTHONPATH and PALPATE_LIBRARY set)."""
import ast
import ctypes
import inspect
import pathlib
import re
import unittest

import palpate
from palpate import _library

ROOT = pathlib.Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "scenes/api/python/palpate"
UNITY = ROOT / "scenes/api/unity"
FUNCTIONS = set(re.findall(r"^function .*?(palpate_\w+)\(", (ROOT / "tests/api/abi.txt").read_text(), re.M))
# The log calls back: warnings are read instead (World.warnings). Definitions are filled by the bindings themselves, and
# names are found in the lists that they keep.
PYTHON_HAS_NOT = {"palpate_set_log", "palpate_log_about", "palpate_default_world_def", "palpate_default_finger_def",
                  "palpate_default_object_def", "palpate_find_finger", "palpate_find_object", "palpate_api_version"}  # fmt: skip
CSHARP_HAS_NOT = {"palpate_set_log", "palpate_log_about", "palpate_default_finger_def", "palpate_default_object_def"}


def members(node):
    """Names in a class of the stub, with the parameters of what is called."""
    found = {}
    for item in node.body:
        if isinstance(item, ast.FunctionDef):
            a = item.args
            plain = any(getattr(d, "id", getattr(d, "attr", "")) in ("property", "setter") for d in item.decorator_list)
            required = len(a.args) - len(a.defaults)
            found[item.name] = None if plain else ([x.arg for x in a.args], a.vararg.arg if a.vararg else None, required)
        elif isinstance(item, ast.AnnAssign):
            found[item.target.id] = None
    return found


def parameters(function):
    all = inspect.signature(function).parameters.values()
    names = [p.name for p in all if p.kind != p.VAR_POSITIONAL]
    rest = next((p.name for p in all if p.kind == p.VAR_POSITIONAL), None)
    return names, rest, sum(p.default is p.empty and p.kind != p.VAR_POSITIONAL for p in all)


class Bindings(unittest.TestCase):
    def test_every_function_is_bound(self):
        python = (PACKAGE / "_library.py").read_text()
        bound = {"palpate_" + name for name in re.findall(r'^    "(\w+)": \[', python, re.M)}
        bound |= set(re.findall(r"library\.(palpate_\w+)\.restype", python))
        self.assertEqual(FUNCTIONS - PYTHON_HAS_NOT, bound)
        called = set(re.findall(r"palpate_\w+", "".join(f.read_text() for f in PACKAGE.glob("*.py"))))
        self.assertLessEqual(bound, called)
        csharp = set(re.findall(r"extern \w+ (palpate_\w+)\(", (UNITY / "Runtime/Native.cs").read_text()))
        self.assertEqual(FUNCTIONS - CSHARP_HAS_NOT, csharp)
        self.assertLessEqual(csharp, set(re.findall(r"Native\.(palpate_\w+)", (UNITY / "Runtime/Palpate.cs").read_text()))
                             | {"palpate_last_error"})  # fmt: skip

    def test_structs_lie_as_in_c(self):
        compared = 0
        for line in (ROOT / "tests/api/abi.txt").read_text().splitlines():
            kind, name, *numbers = line.split()
            struct, _, field = name.removeprefix("Palpate").partition(".")
            if kind == "struct":
                self.assertEqual(int(numbers[0]), ctypes.sizeof(getattr(_library, struct)), line)
            if kind == "field":
                place = getattr(getattr(_library, struct), field)
                self.assertEqual((int(numbers[1]), int(numbers[3])), (place.offset, place.size), line)
                compared += 1
        self.assertGreater(compared, 60)

    def test_the_stub_says_what_the_package_has(self):
        stub = ast.parse((PACKAGE / "__init__.pyi").read_text())
        said = {n.name for n in stub.body if isinstance(n, (ast.FunctionDef, ast.ClassDef)) and not n.name.startswith("_")}
        imported = {a.asname for n in stub.body if isinstance(n, ast.ImportFrom) for a in n.names if a.asname}
        self.assertEqual(set(palpate.__all__), said | imported)
        world = palpate.build([{"name": "index", "elements": 120, "device": "chinello-3rrs", "pose": [0, 0, 0.01, 1, 0, 0, 0]}],
                              [{"shape": "plane"}])  # fmt: skip
        things = {"World": world, "Finger": world.fingers[0], "Object": world.objects[0], "Thimble": world.thimbles[0],
                  "Vector": palpate.vector(world, 1), "_Named": world.fingers}  # fmt: skip
        shared = {}  # by base class
        for node in stub.body:
            if isinstance(node, ast.FunctionDef):
                self.assertEqual(members(ast.Module([node], []))[node.name], parameters(getattr(palpate, node.name)), node.name)
            if not isinstance(node, ast.ClassDef):
                continue
            found = members(node) | {name: takes for base in node.bases for name, takes in shared.get(getattr(base, "id", ""), {}).items()}
            if node.name == "_Tissue":
                shared[node.name] = found
                continue
            thing = things.pop(node.name)
            public = {name for name in dir(thing) if not name.startswith("_")}
            self.assertEqual(public, {name for name in found if not name.startswith("_")}, node.name)
            for name, takes in found.items():
                self.assertTrue(hasattr(type(thing), name) or name in public, f"{node.name}.{name}")
                if takes:
                    self.assertEqual(takes, parameters(getattr(type(thing), name)), f"{node.name}.{name}")
        self.assertEqual({}, things)

    def test_everything_says_what_it_is(self):
        for name in palpate.__all__:
            thing = getattr(palpate, name)
            self.assertTrue(thing.__doc__, name)
            self.assertEqual("palpate", thing.__module__)
            for member, value in vars(thing).items() if inspect.isclass(thing) else ():
                if not member.startswith("_") and (callable(value) or isinstance(value, property)):
                    self.assertTrue(value.__doc__, f"{name}.{member}")
        for shape in ("positions", "forces", "pressures", "nodes", "tetrahedra", "stretches"):
            for kind in palpate.Finger, palpate.Object:
                self.assertRegex(getattr(kind, shape).__doc__, r"\[[SNEF]")

    def test_the_sample_of_unity_refers_to_what_is_there(self):
        scripts = {}
        for meta in UNITY.glob("**/*.meta"):
            self.assertTrue(meta.with_suffix("").exists(), meta)
            guid = re.search(r"^guid: ([0-9a-f]{32})$", meta.read_text(), re.M)[1]
            self.assertNotIn(guid, scripts)
            scripts[guid] = meta.with_suffix("")
        for file in (UNITY / "Runtime").iterdir():
            self.assertTrue(file.suffix == ".meta" or file in scripts.values(), f"{file} has no .meta")
        scene = (UNITY / "Samples~/Press/Press.unity").read_text()
        documents = {m[1]: m[0] for m in re.findall(r"^(--- !u!\d+ &(\d+)\n.*?)(?=^---|\Z)", scene, re.M | re.S)}
        for reference in re.findall(r"\{fileID: (\d+)\}", scene):
            self.assertTrue(reference == "0" or reference in documents, reference)
        components = 0
        for text in documents.values():
            script = re.search(r"m_Script: \{fileID: 11500000, guid: ([0-9a-f]{32}), type: 3\}\n(.*)", text, re.S)
            if not script:
                continue
            source = scripts[script[1]].read_text()
            for field in re.findall(r"^  (\w+):", script[2], re.M):
                self.assertRegex(source, rf"public [\w.\[\]]+ {field}\b")
            components += 1
        self.assertEqual(3, components)
        names = re.findall(r"^  (?:finger|thing): (\w+)$", scene, re.M)
        world = palpate.load(ROOT / "scenes/press.toml")
        self.assertEqual(names, [world.fingers[0].name, world.objects[0].name])


if __name__ == "__main__":
    unittest.main()
