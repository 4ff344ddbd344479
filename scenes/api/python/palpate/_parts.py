"""What is in a world: fingers, objects, thimbles."""
import ctypes

import numpy

from . import _library
from ._library import Error, check, library, numbers_of_pose, text_for_c

# Fields of palpate.h.
_POSITIONS, _FORCES, _TOUCHES, _PRESSURES, _AREAS, _FACES, _SAMPLE_NODES, _NODES, _REST_NODES, _TETRAHEDRA = range(10)
_STRETCHES, _CONFIGURATION, _WANTED, _SENT, _REACHED, _BONES, _TRACKED, _NET, _TORQUES, _CENTRES = range(10, 20)
_CONTACT_AREAS, _OBJECT_POSES, _OBJECT_MOTIONS = range(20, 23)
_OBJECT_FORCES, _BY_OBJECT, _SOFT = 23, 24, 25  # from _SOFT on: _POSITIONS to _STRETCHES of a soft object


class _Named:
    """Finger, objects or thimbles, by name or number."""

    def __init__(self, what, rows, names):
        self._what, self._rows, self._names = what, rows, names

    def __getitem__(self, key):
        if isinstance(key, str):
            if key not in self._names:
                raise KeyError(f"there is no {self._what} {key!r}; there are: {', '.join(self._names)}")
            return self._rows[self._names.index(key)]
        return self._rows[key]

    def __len__(self):
        return len(self._rows)

    def __iter__(self):
        return iter(self._rows)

    def __contains__(self, name):
        return name in self._names

    def keys(self):
        """The names."""
        return list(self._names)

    def __repr__(self):
        return f"<{len(self)} {self._what}s: {', '.join(self._names)}>"


def _view(field, doc):
    def get(self):
        return self._world._view(field, self.index)

    get.__doc__ = doc
    return property(get)


def _row(field, part, doc):
    def get(self):
        return self._world._view(field, -1)[self._at()][part]

    get.__doc__ = doc
    return property(get)


class _Part:
    """`index` is its id in palpate.h; what was removed raises Error."""

    __slots__ = ("_world", "index", "name", "_row")  # a mistyped name is an error

    def __init__(self, world, index, name, row):
        self._world, self.index, self.name, self._row = world, index, name, row

    def _at(self):
        if self._row is None:
            raise Error(-1, f"{self.name} has been removed")
        return self._row


def _tissue_view(field, doc):
    def get(self):
        return self._world._view(self._first_field + field, self.index)

    get.__doc__ = doc
    return property(get)


class _Tissue(_Part):
    """What fingers and soft objects have: a mesh, its surface, and what presses there. S samples, N nodes, E tetrahedra."""

    __slots__ = ()

    positions = _tissue_view(_POSITIONS, "Places of its samples [S, 3], world [m].")
    forces = _tissue_view(_FORCES, "Contact forces on its samples [S, 3], world [N].")
    touches = _tissue_view(_TOUCHES, "1 for each sample that is pushed [S].")
    pressures = _tissue_view(_PRESSURES, "Contact pressure by sample [S], [Pa].")
    areas = _tissue_view(_AREAS, "Share of each sample in the surface at rest [S], [m^2].")
    faces = _tissue_view(_FACES, "Triangles of the pad [F, 3], samples, outward.")
    sample_nodes = _tissue_view(_SAMPLE_NODES, "Node of each sample [S].")
    nodes = _tissue_view(_NODES, "All nodes [N, 3], world [m].")
    rest_nodes = _tissue_view(_REST_NODES, "All nodes at rest [N, 3], its own frame [m].")
    tetrahedra = _tissue_view(_TETRAHEDRA, "Nodes of each tetrahedron [E, 4].")
    stretches = _tissue_view(_STRETCHES, "Smallest and largest principal stretch of each tetrahedron [E, 2].")


class Finger(_Tissue):
    """A finger of a world."""

    __slots__ = ()
    _first_field = 0

    @property
    def pose(self):
        """Tracked pose [7]: the newest that was seen. Set it, and the finger follows that instead of its track from the
        next step on; None: its tracker does not see it."""
        return self._world._view(_TRACKED, -1)[self._at()]

    @pose.setter
    def pose(self, pose):
        id = self._world._handle.id
        if pose is None:
            return check(library.palpate_set_finger_pose(id, self.index, None))
        check(library.palpate_set_finger_pose(id, self.index, numbers_of_pose(pose)))

    def release(self):
        """It follows its track again."""
        check(library.palpate_release_finger(self._world._handle.id, self.index))

    bone = _row(_BONES, slice(None), "Pose of its bone [7].")
    force = _row(_NET, slice(None), "Net contact force on the skin [3], world [N].")
    torque = _row(_TORQUES, slice(None), "Torque of its contact forces about the bone's origin [3], world [N m].")
    centre = _row(_CENTRES, slice(None), "Centre of pressure [3], world [m]; NaN where nothing pushes.")
    area = _row(_CONTACT_AREAS, (), "Contact area [m^2].")

    forces_by_object = _view(_BY_OBJECT, "Forces of each object on its skin [objects, 3], world [N].")

    @property
    def state(self):
        """What the last step did: see PalpateFingerState in palpate.h (converged, residual, iterations, ...)."""
        state = _library.FingerState()
        check(library.palpate_get_finger(self._world._handle.id, self.index, ctypes.byref(state)))
        return state

    def snapshot(self):
        """From any thread: (state, positions [S, 3], forces [S, 3]) of the newest step, as copies. The world's owner calls
        world.keep_snapshots() before."""
        state, count = _library.FingerState(), ctypes.c_int32()
        id = self._world._handle.id
        check(library.palpate_read_snapshot(id, self.index, ctypes.byref(state), None, None, 0, ctypes.byref(count)))
        positions, forces = numpy.empty((count.value, 3)), numpy.empty((count.value, 3))
        check(library.palpate_read_snapshot(id, self.index, ctypes.byref(state), positions.ctypes.data, forces.ctypes.data,
                                            count, None))  # fmt: skip
        return state, positions, forces

    @property
    def thimble(self):
        """The simulated thimble that it wears; None where it wears none. Set it to the name of a kind, or to None."""
        return next((t for t in self._world.thimbles if t.state.finger == self.index), None)

    @thimble.setter
    def thimble(self, kind):
        check(library.palpate_set_thimble(self._world._handle.id, self.index, text_for_c(kind), None))
        self._world._take_parts()

    def remove(self):
        """Takes it out of the world. Arrays of it stay as they are."""
        check(library.palpate_remove_finger(self._world._handle.id, self.index))
        self._world._take_parts()

    def __repr__(self):
        x, y, z = self.force
        return f"<finger {self.name}: {x:.3f} {y:.3f} {z:.3f} N on {1e6 * self.area:.1f} mm2>"


class Object(_Tissue):
    """An object of a world. Places and forces of its surface (positions, forces, ...) has a soft one alone: others raise Error."""

    __slots__ = ()
    _first_field = _SOFT

    @property
    def pose(self):
        """Pose [7]. Set it where no forces move the object, and it goes there in the next step."""
        return self._world._view(_OBJECT_POSES, -1)[self._at()]

    @pose.setter
    def pose(self, pose):
        check(library.palpate_set_object_pose(self._world._handle.id, self.index, numbers_of_pose(pose)))

    def release(self):
        """It stays, or follows its track, again."""
        check(library.palpate_release_object(self._world._handle.id, self.index))

    def remove(self):
        """Takes it out of the world."""
        check(library.palpate_remove_object(self._world._handle.id, self.index))
        self._world._take_parts()

    force = _row(_OBJECT_FORCES, slice(None), "Force on it [3], world [N]; of fingers and soft objects alone where it is fixed and rigid.")
    velocity = _row(_OBJECT_MOTIONS, slice(0, 3), "Velocity of its centre of mass [3], [m/s].")
    spin = _row(_OBJECT_MOTIONS, slice(3, 6), "Angular velocity [3], world [rad/s].")

    @property
    def state(self):
        """See PalpateObjectState in palpate.h: moves, pose, velocity, spin, force, torque, soft, ..."""
        state = _library.ObjectState()
        check(library.palpate_get_object(self._world._handle.id, self.index, ctypes.byref(state)))
        return state

    def __repr__(self):
        x, y, z = 1e3 * self.pose[:3]
        return f"<object {self.name} at {x:.2f} {y:.2f} {z:.2f} mm>"


class Thimble(_Part):
    """A simulated thimble of a world."""

    __slots__ = ()

    kind = property(lambda self: self.name, doc="Of its device.")

    configuration = _view(_CONFIGURATION, "Its configuration [C], [rad or m].")
    wanted = _view(_WANTED, "Joint angles of the newest match [J], [rad].")
    sent = _view(_SENT, "Joint angles sent, in range and slew-limited [J], [rad].")
    reached = _view(_REACHED, "Joint angles that its servos have reached [J], [rad].")

    @property
    def state(self):
        """See PalpateThimbleState in palpate.h."""
        state = _library.ThimbleState()
        check(library.palpate_get_thimble(self._world._handle.id, self.index, ctypes.byref(state)))
        return state

    def __repr__(self):
        return f"<thimble {self.kind}: {numpy.degrees(self.sent).round(1)} degrees>"
