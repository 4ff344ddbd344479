"""libpalpate.so by ctypes: where it is, what its functions take, how errors become exceptions."""
import ctypes
import os
import pathlib
from operator import index

from ctypes import POINTER, c_char_p, c_double, c_int32, c_int64, c_void_p


class Error(RuntimeError):
    """What palpate could not do; the message says what was wrong, where, and how to mend it. `code` is that of palpate.h."""

    def __init__(self, code, message):
        super().__init__(message)
        self.code = code


class SceneError(Error, ValueError):
    """A scene, setting, state or recording that cannot be used."""


class BusyError(Error):
    """Another thread is using the world."""


def _candidates():
    """Where the library may be: as the environment says, beside an installed package, in a checkout's build, as the
    system finds it."""
    if os.environ.get("PALPATE_LIBRARY"):
        return [os.environ["PALPATE_LIBRARY"]]
    here = pathlib.Path(__file__).resolve()
    found = []
    for parent in list(here.parents)[1:4]:  # lib/python3/dist-packages/palpate
        found += [parent / "libpalpate.so.0", *sorted(parent.glob("*-linux-gnu/libpalpate.so.0"))]
    if here.parents[2].name == "api" and len(here.parents) > 4:
        found = [here.parents[4] / "build/release/libpalpate.so.0"] + found
    return [str(f) for f in found if f.exists()] + ["libpalpate.so.0"]


def _open():
    said = ""
    for path in _candidates():
        try:
            return ctypes.CDLL(path)
        except OSError as error:
            said = str(error)
    raise ImportError(
        f"libpalpate.so.0 was not found ({said}); build it (cmake --build build/release --target palpate_c), or set "
        "PALPATE_LIBRARY to where it lies"
    )


class Struct(ctypes.Structure):
    """Begins with its size."""

    def __init__(self, **values):
        super().__init__(size=ctypes.sizeof(type(self)), **values)

    def __repr__(self):
        show = lambda value: list(value) if isinstance(value, ctypes.Array) else value
        fields = (f"{name}={show(getattr(self, name))}" for name, _ in self._fields_ if name not in ("size", "reserved"))
        return f"<{type(self).__name__} {', '.join(fields)}>"


class WorldDef(Struct):
    _fields_ = [
        ("size", c_int32), ("threads", c_int32), ("settings", POINTER(c_char_p)), ("setting_count", c_int32),
        ("reserved", c_int32), ("folder", c_char_p),
    ]  # fmt: skip


class FingerDef(Struct):
    _fields_ = [
        ("size", c_int32), ("elements", c_int32), ("name", c_char_p), ("finger", c_char_p), ("device", c_char_p),
        ("method", c_char_p), ("pose", c_double * 7), ("young_modulus", c_double),
    ]  # fmt: skip


class ObjectDef(Struct):
    _fields_ = [
        ("size", c_int32), ("shape", c_int32), ("name", c_char_p), ("file", c_char_p), ("dimensions", c_double * 3),
        ("pose", c_double * 7), ("friction", c_double), ("stiffness", c_double), ("mass", c_double),
        ("young_modulus", c_double), ("poisson", c_double), ("fixed", c_char_p),
        ("fixed_depth", c_double), ("elements", c_int32), ("reserved", c_int32),
    ]  # fmt: skip


class SceneDef(Struct):
    _fields_ = [
        ("size", c_int32), ("finger_count", c_int32), ("fingers", POINTER(FingerDef)), ("objects", POINTER(ObjectDef)),
        ("object_count", c_int32), ("reserved", c_int32), ("dt", c_double), ("gravity", c_double * 3), ("preset", c_char_p),
        ("more", c_char_p),
    ]  # fmt: skip


class WorldInfo(Struct):
    _fields_ = [
        ("size", c_int32), ("finger_count", c_int32), ("object_count", c_int32), ("thimble_count", c_int32),
        ("time", c_double), ("dt", c_double), ("duration", c_double), ("step", c_int64), ("generation", c_int64),
    ]  # fmt: skip


class View(Struct):
    _fields_ = [
        ("size", c_int32), ("type", c_int32), ("rank", c_int32), ("shape", c_int32 * 2), ("reserved", c_int32),
        ("generation", c_int64), ("data", c_void_p),
    ]  # fmt: skip


class FingerState(Struct):
    _fields_ = [
        ("size", c_int32), ("touching", c_int32), ("time", c_double), ("tracked_pose", c_double * 7),
        ("bone_pose", c_double * 7), ("force", c_double * 3), ("torque", c_double * 3), ("centre", c_double * 3),
        ("normal_force", c_double), ("contact_area", c_double), ("coupling_force", c_double), ("silent", c_double),
        ("residual", c_double), ("converged", c_int32), ("iterations", c_int32), ("resets", c_int64),
    ]  # fmt: skip


class ObjectState(Struct):
    _fields_ = [
        ("size", c_int32), ("moves", c_int32), ("pose", c_double * 7), ("velocity", c_double * 3), ("spin", c_double * 3),
        ("force", c_double * 3), ("torque", c_double * 3), ("contact_area", c_double), ("soft", c_int32), ("touching", c_int32),
    ]  # fmt: skip


class ThimbleState(Struct):
    _fields_ = [
        ("size", c_int32), ("finger", c_int32), ("configuration_count", c_int32), ("joint_count", c_int32),
        ("configuration", c_double * 6), ("wanted", c_double * 6), ("sent", c_double * 6), ("reached", c_double * 6),
        ("error", c_double), ("matches", c_int32), ("at_limit", c_int32),
    ]  # fmt: skip


class ReplayState(Struct):
    _fields_ = [("size", c_int32), ("same", c_int32), ("steps", c_int64), ("done", c_int64), ("different", c_int64)]


library = _open()
library.palpate_last_error.restype = c_char_p
library.palpate_version.restype = c_char_p
Pose = POINTER(c_double)
for _name, _arguments in {
    "load": [c_char_p, POINTER(WorldDef), POINTER(c_int64)],
    "load_text": [c_char_p, POINTER(WorldDef), POINTER(c_int64)],
    "default_scene_def": [POINTER(SceneDef), c_int32],
    "build": [POINTER(SceneDef), POINTER(WorldDef), POINTER(c_int64)],
    "load_replay": [c_char_p, c_int32, POINTER(WorldDef), POINTER(c_int64)],
    "clone": [c_int64, POINTER(c_int64)],
    "destroy": [c_int64],
    "get_info": [c_int64, POINTER(WorldInfo)],
    "get_text": [c_int64, c_int32, c_int32, c_char_p, c_int64, POINTER(c_int64)],
    "set": [c_int64, POINTER(c_char_p), c_int32],
    "list": [c_int64, c_int32, POINTER(c_int32), c_int32, POINTER(c_int32)],
    "add_finger": [c_int64, POINTER(FingerDef), POINTER(c_int32)],
    "remove_finger": [c_int64, c_int32],
    "add_object": [c_int64, POINTER(ObjectDef), POINTER(c_int32)],
    "remove_object": [c_int64, c_int32],
    "set_thimble": [c_int64, c_int32, c_char_p, c_char_p],
    "set_finger_pose": [c_int64, c_int32, c_void_p],
    "release_finger": [c_int64, c_int32],
    "set_object_pose": [c_int64, c_int32, c_void_p],
    "release_object": [c_int64, c_int32],
    "step": [c_int64, c_int32],
    "step_to": [c_int64, c_double],
    "step_many": [c_void_p, c_int32, c_int32],
    "view": [c_int64, c_int32, c_int32, POINTER(View)],
    "get_finger": [c_int64, c_int32, POINTER(FingerState)],
    "get_object": [c_int64, c_int32, POINTER(ObjectState)],
    "get_thimble": [c_int64, c_int32, POINTER(ThimbleState)],
    "keep_snapshots": [c_int64, c_int32],
    "read_snapshot": [c_int64, c_int32, POINTER(FingerState), c_void_p, c_void_p, c_int32, POINTER(c_int32)],
    "keep_frames": [c_int64, c_double],
    "save": [c_int64, c_void_p, c_int64, POINTER(c_int64)],
    "restore": [c_int64, c_char_p, c_int64],
    "record": [c_int64, c_char_p],
    "end_recording": [c_int64],
    "get_replay": [c_int64, POINTER(ReplayState)],
}.items():
    _function = getattr(library, "palpate_" + _name)
    _function.argtypes, _function.restype = _arguments, c_int32


def check(code):
    """Raises what a code stands for."""
    if code:
        message = library.palpate_last_error().decode(errors="replace")
        raise {-3: SceneError, -4: BusyError}.get(code, Error)(code, message)


class Handle:
    """Keeps a world alive as long as anything that shows it."""

    def __init__(self, id):
        self.id = id

    def __del__(self):
        library.palpate_destroy(self.id)


def text_for_c(text):
    """For C: None where there is none."""
    text = "" if text is None else str(text)
    if "\0" in text:
        raise ValueError(f"a text for palpate has no zero in it, found {text[:80]!r}")
    return text.encode() if text else None


def whole(name, value):
    """A whole number that fits; ctypes would cut it down to 32 bits."""
    value = index(value)
    if abs(value) >= 2**31:
        raise ValueError(f"{name}: {value} is far too many")
    return value


Seven = c_double * 7


def numbers_of_pose(pose):
    if len(pose) != 7:
        raise ValueError(f"a pose is 7 numbers: position x y z [m], rotation w x y z; found {len(pose)}")
    return Seven(*pose)
