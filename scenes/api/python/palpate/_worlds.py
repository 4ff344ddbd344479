"""Worlds."""
import ctypes
from operator import index

import numpy

from . import _library
from ._library import check, library, numbers_of_pose, text_for_c, whole
from ._parts import (_BONES, _BY_OBJECT, _CENTRES, _CONFIGURATION, _CONTACT_AREAS, _NET, _OBJECT_FORCES, _OBJECT_MOTIONS, _OBJECT_POSES,
                     _POSITIONS, _REACHED, _SOFT, _STRETCHES, _TORQUES, _TRACKED, Finger, Object, Thimble, _Named)  # fmt: skip
from ._pictures import page

_SCENE, _WARNINGS, _SETTINGS, _FOLDER, _FINGER, _OBJECT, _THIMBLE, _FILE, _REPORT = range(9)
_MOST_STEPS = 1000000
_AT_ONCE = 64  # steps of one call: Python hears of signals between calls
_NUMBERS = [(ctypes.c_double, numpy.float64), (ctypes.c_int32, numpy.int32), (ctypes.c_uint8, numpy.uint8)]


def _definition(settings, threads, folder=None):
    if hasattr(settings, "items"):
        settings = [f"{key}={value}" for key, value in settings.items()]
    texts = [text_for_c(s) for s in ([settings] if isinstance(settings, str) else settings)]
    definition = _library.WorldDef(threads=whole("threads", threads), setting_count=len(texts), folder=text_for_c(folder))
    definition.settings = (ctypes.c_char_p * max(1, len(texts)))(*texts)
    return definition


def _made(function, *arguments):
    id = ctypes.c_int64()
    check(function(*arguments, ctypes.byref(id)))
    return World(_library.Handle(id.value))


def load(scene, settings=(), threads=1):
    """A world from a scene file, or from the name of a scene that comes with palpate ("hand").

    settings: texts such as "solver.preset=balanced", or a dictionary of them; threads: that a step uses, 0 for as many as the machine has.
    """
    return _made(library.palpate_load, text_for_c(scene), _definition(settings, threads))


def load_text(text, settings=(), threads=1, folder=None):
    """A world from the text of a scene (TOML); `folder` is where the files that it names are."""
    return _made(library.palpate_load_text, text_for_c(text), _definition(settings, threads, folder))


def build(fingers, objects=(), dt=0.001, gravity=(0, 0, -9.81), preset="balanced", more="", settings=(), threads=1):
    """A world from descriptions: dictionaries of what World.add_finger and World.add_object take.

        palpate.build([{"name": "index", "pose": [0, 0, 0.006, 1, 0, 0, 0]}], [{"shape": "plane", "friction": 0.5}])

    dt: of a step [s]; gravity [3] on bodies [m/s^2]; preset: of the solver; more: further lines of the scene (TOML), before
    its fingers and objects. world.scene is the text that they become.
    """
    if len(gravity) != 3:
        raise ValueError(f"gravity: three numbers [m/s^2], found {len(gravity)}")
    scene = _library.SceneDef()
    check(library.palpate_default_scene_def(ctypes.byref(scene), ctypes.sizeof(scene)))
    fingers, objects = [_finger_def(**f) for f in fingers], [_object_def(**o) for o in objects]
    scene.finger_count, scene.object_count = len(fingers), len(objects)
    scene.fingers = (_library.FingerDef * max(1, len(fingers)))(*fingers)
    scene.objects = (_library.ObjectDef * max(1, len(objects)))(*objects)
    scene.dt, scene.gravity = dt, tuple(gravity)
    scene.preset, scene.more = text_for_c(preset), text_for_c(more)
    return _made(library.palpate_build, scene, _definition(settings, threads))


def _finger_def(name=None, finger="index-median", pose=(0, 0, 0, 1, 0, 0, 0), elements=0, young_modulus=0, device=None, method=None):
    return _library.FingerDef(name=text_for_c(name), finger=text_for_c(finger), device=text_for_c(device), method=text_for_c(method), elements=whole("elements", elements),
                              pose=numbers_of_pose(pose), young_modulus=young_modulus)  # fmt: skip


_SHAPES = ["plane", "box", "sphere", "capsule", "cylinder", "mesh"]


def _object_def(shape, dimensions=(), name=None, pose=(0, 0, 0, 1, 0, 0, 0), friction=0, stiffness=0, mass=0, file=None, young_modulus=0,
                poisson=0, fixed="bottom", fixed_depth=0, elements=0):  # fmt: skip
    if shape not in _SHAPES:
        raise ValueError(f"there is no shape {shape!r}; there are: {', '.join(_SHAPES)}")
    numbers = [float(d) for d in dimensions]
    if len(numbers) > 3:
        raise ValueError(f"dimensions: edges x y z, or radius and length [m]; found {len(numbers)} numbers")
    return _library.ObjectDef(shape=_SHAPES.index(shape), name=text_for_c(name), friction=friction, file=text_for_c(file), stiffness=stiffness,
                              mass=mass, young_modulus=young_modulus, poisson=poisson, fixed=text_for_c(fixed), fixed_depth=fixed_depth,
                              elements=whole("elements", elements), pose=numbers_of_pose(pose), dimensions=tuple((numbers + [0, 0, 0])[:3]))  # fmt: skip


def replay(file, run=1, threads=1):
    """A world that goes through a recorded run again: step() takes what went in then. See World.replayed."""
    return _made(library.palpate_load_replay, text_for_c(file), whole("run", run), _definition((), threads))


_OWN_FIELDS = [range(_POSITIONS, _STRETCHES + 1), range(_SOFT, _SOFT + _STRETCHES + 1), range(_CONFIGURATION, _REACHED + 1)]


class World:
    """A scene that is being run; made by load, load_text, build, replay or copy."""

    __slots__ = ("_handle", "_views", "_parts", "_changes", "fingers", "objects", "thimbles", "__weakref__")  # a mistyped name is an error

    def __init__(self, handle):
        self._handle, self._views = handle, {}
        self._parts, self._changes = [{}, {}, {}], 0
        self._take_parts()

    def _take_parts(self):
        """What there is now. Views of the world are asked for anew, those of what stays keep their places."""
        self._changes += 1
        self._views = {key: view for key, view in self._views.items() if key[1] >= 0 and key[0] != _BY_OBJECT}
        kinds = [("finger", Finger, _FINGER), ("object", Object, _OBJECT), ("thimble", Thimble, _THIMBLE)]
        named = []
        for what, (label, kind, text) in enumerate(kinds):
            before, now = self._parts[what], {}
            for row, id in enumerate(self._ids(what)):
                now[id] = before.get(id) or kind(self, id, self._text(text, id), row)
                now[id]._row = row
            for id, part in before.items():
                if id not in now:
                    part._row = None
                    for field in _OWN_FIELDS[what]:
                        self._views.pop((field, id), None)
            self._parts[what] = now
            named.append(_Named(label, list(now.values()), [part.name for part in now.values()]))
        self.fingers, self.objects, self.thimbles = named

    def _ids(self, what):
        count = ctypes.c_int32()
        check(library.palpate_list(self._handle.id, what, None, 0, ctypes.byref(count)))
        ids = (ctypes.c_int32 * max(1, count.value))()
        check(library.palpate_list(self._handle.id, what, ids, len(ids), ctypes.byref(count)))
        return ids[: count.value]

    def _info(self):
        info = _library.WorldInfo()
        check(library.palpate_get_info(self._handle.id, ctypes.byref(info)))
        return info

    def _text(self, text, index=0):
        needed = ctypes.c_int64()
        check(library.palpate_get_text(self._handle.id, text, index, None, 0, ctypes.byref(needed)))
        buffer = ctypes.create_string_buffer(needed.value)
        check(library.palpate_get_text(self._handle.id, text, index, buffer, needed, None))
        return buffer.value.decode(errors="replace")

    def _view(self, field, index):
        try:
            return self._views[field, index]
        except KeyError:
            pass
        view = _library.View()
        check(library.palpate_view(self._handle.id, field, index, ctypes.byref(view)))
        number, dtype = _NUMBERS[view.type]
        shape = tuple(view.shape[: view.rank])
        size = int(numpy.prod(shape))
        if size == 0:
            return self._views.setdefault((field, index), numpy.zeros(shape, dtype))
        memory = (number * size).from_address(view.data)
        memory.handle = self._handle  # the world lives as long as its views
        array = numpy.frombuffer(memory, dtype).reshape(shape)
        array.flags.writeable = False
        return self._views.setdefault((field, index), array)

    def step(self, n=1):
        """n steps. An interrupt (Ctrl-C) ends them early, between two steps."""
        n = index(n)
        if abs(n) > _MOST_STEPS:
            raise ValueError(f"expected 1 to {_MOST_STEPS} steps at once, found {n}: step in parts")
        while n > _AT_ONCE:
            check(library.palpate_step(self._handle.id, _AT_ONCE))
            n -= _AT_ONCE
        code = library.palpate_step(self._handle.id, n)
        if code:
            check(code)

    def step_to(self, time):
        """Steps until the simulated time [s] is reached to half a step. An interrupt (Ctrl-C) ends them early."""
        info = self._info()
        left = (time - info.time) / info.dt
        if _AT_ONCE < left <= _MOST_STEPS:
            self.step(round(left) - 1)
        check(library.palpate_step_to(self._handle.id, time))

    bones = property(lambda self: self._view(_BONES, -1), doc="Bone poses [fingers, 7].")
    tracked_poses = property(lambda self: self._view(_TRACKED, -1), doc="Newest tracked poses [fingers, 7].")
    forces = property(lambda self: self._view(_NET, -1), doc="Net contact forces [fingers, 3], world [N].")
    torques = property(lambda self: self._view(_TORQUES, -1), doc="Their torques [fingers, 3], [N m].")
    centres = property(lambda self: self._view(_CENTRES, -1), doc="Centres of pressure [fingers, 3], [m].")
    areas = property(lambda self: self._view(_CONTACT_AREAS, -1), doc="Contact areas [fingers], [m^2].")
    object_poses = property(lambda self: self._view(_OBJECT_POSES, -1), doc="Poses of objects [objects, 7].")
    object_forces = property(lambda self: self._view(_OBJECT_FORCES, -1), doc="Forces on objects [objects, 3], world [N]: see Object.force.")
    object_motions = property(lambda self: self._view(_OBJECT_MOTIONS, -1), doc="Velocities, angular velocities [objects, 6].")

    time = property(lambda self: self._info().time, doc="Simulated time [s].")
    dt = property(lambda self: self._info().dt, doc="Length of a step [s].")
    duration = property(lambda self: self._info().duration, doc="Of a run of the program [s].")
    steps = property(lambda self: self._info().step, doc="Steps done.")
    generation = property(lambda self: self._info().generation, doc="Grows whenever views change.")
    scene = property(lambda self: self._text(_SCENE), doc="Text of the scene.")
    settings = property(lambda self: [s for s in self._text(_SETTINGS).split("\n") if s], doc="What was set over it.")
    warnings = property(lambda self: [w for w in self._text(_WARNINGS).split("\n") if w], doc="Likely mistakes in the scene.")

    def set(self, *settings):
        """Changes settings while it runs: world.set("finger.index.material.young_kPa=40")."""
        texts = [text_for_c(s) for s in settings]
        check(library.palpate_set(self._handle.id, (ctypes.c_char_p * max(1, len(texts)))(*texts), len(texts)))

    def add_finger(self, name=None, finger="index-median", pose=(0, 0, 0, 1, 0, 0, 0), elements=0, young_modulus=0,
                   device=None, method=None):  # fmt: skip
        """A finger more, from a preset or finger file, at a tracked pose; takes tens of milliseconds. Returns it. The others
        go on as they were."""
        definition, id = _finger_def(name, finger, pose, elements, young_modulus, device, method), ctypes.c_int32()
        check(library.palpate_add_finger(self._handle.id, ctypes.byref(definition), ctypes.byref(id)))
        self._take_parts()
        return self._parts[0][id.value]

    def add_object(self, shape, dimensions=(), name=None, pose=(0, 0, 0, 1, 0, 0, 0), friction=0, stiffness=0, mass=0, file=None,
                   young_modulus=0, poisson=0, fixed="bottom", fixed_depth=0, elements=0):  # fmt: skip
        """An object more. shape: plane, box, sphere, capsule, cylinder or mesh; dimensions: edges x y z, or radius and length
        [m]; friction: Coulomb coefficient; stiffness: pressure per depth [Pa/m], 0 is rigid; mass: forces move it [kg], 0 is
        fixed; young_modulus [Pa]: it is tissue of so many elements, held at its side
        `fixed`, fixed_depth deep [m]. Returns it."""
        definition, id = _object_def(shape, dimensions, name, pose, friction, stiffness, mass, file, young_modulus, poisson, fixed,
                                     fixed_depth, elements), ctypes.c_int32()
        check(library.palpate_add_object(self._handle.id, ctypes.byref(definition), ctypes.byref(id)))
        self._take_parts()
        return self._parts[1][id.value]

    def save(self):
        """The whole state as bytes: a branch point."""
        size = ctypes.c_int64()
        check(library.palpate_save(self._handle.id, None, 0, ctypes.byref(size)))
        state = ctypes.create_string_buffer(size.value)
        check(library.palpate_save(self._handle.id, state, size, ctypes.byref(size)))
        return state.raw[: size.value]

    def restore(self, state):
        """Back to a saved state, of this world or another of the same scene and settings: it goes on with the same bits."""
        check(library.palpate_restore(self._handle.id, state, len(state)))

    def copy(self):
        """Another world in the same state."""
        return _made(library.palpate_clone, self._handle.id)

    __copy__ = copy

    def __deepcopy__(self, memo):
        return self.copy()

    def __reduce__(self):
        file = self._text(_FILE)
        return _unpickled, (file, None if file else self.scene, self._text(_FOLDER), self.settings, self.save())

    def keep_snapshots(self, on=True):
        """From now on every step leaves a snapshot for Finger.snapshot()."""
        check(library.palpate_keep_snapshots(self._handle.id, on))

    def keep_frames(self, rate=30):
        """From now on so many frames per simulated second are kept for report(); 0: none any longer."""
        check(library.palpate_keep_frames(self._handle.id, rate))

    def report(self, file=None):
        """One HTML page that needs no network: 3-D playback of kept frames (see keep_frames), or of now, plots and summary.
        Written to a file, if one is given, else returned."""
        text = self._text(_REPORT)
        if file is None:
            return text
        with open(file, "w", encoding="utf-8") as out:
            out.write(text)

    def record(self, file):
        """From the first step on everything is recorded into a file, which `palpate replay` and palpate.replay read."""
        check(library.palpate_record(self._handle.id, text_for_c(file)))

    def end_recording(self):
        """Ends the recording in order."""
        check(library.palpate_end_recording(self._handle.id))

    @property
    def replayed(self):
        """Of a replay: steps, done, same (1 while all came out the same bit for bit), different (first step that did not)."""
        state = _library.ReplayState()
        check(library.palpate_get_replay(self._handle.id, ctypes.byref(state)))
        return state

    def __repr__(self):
        return f"<palpate world at {self.time:.4f} s: {len(self.fingers)} fingers, {len(self.objects)} objects, {len(self.thimbles)} thimbles>"

    def _repr_html_(self):
        """For notebooks: each pad from below, its faces coloured by contact pressure, what it feels, and the report."""
        return page(self)


def _unpickled(file, text, folder, settings, state):
    world = load(file, settings) if file else load_text(text, settings, folder=folder)
    world.restore(state)
    return world
