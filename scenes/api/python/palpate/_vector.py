"""Many worlds that are stepped together."""
import numpy

from ._library import Error, check, library, whole
from ._parts import _BONES, _CONTACT_AREAS, _NET, _OBJECT_MOTIONS, _OBJECT_POSES, _TORQUES
from ._worlds import World, load


class Vector:
    """n worlds of one scene that are stepped together, in parallel, after gymnasium's convention for vector environments.

    actions: [n, fingers, 3] positions or [n, fingers, 7] poses of the tracked fingers; 3 keep the rotation that they
    begin with. Observations: float64 [n, observation_size], per finger bone pose 7, force 3, torque 3, area 1, then per
    object pose 7, velocity 3, angular velocity 3. Derive from it and override reward, terminated and start.
    """

    def __init__(self, scene, n, settings=(), substeps=1, horizon=None):
        """scene: as of load; substeps: steps of the simulation per action; horizon: actions until truncation, by default
        the scene's duration."""
        if n < 1:
            raise ValueError(f"n: one world at least, found {n}")
        if not 1 <= whole("substeps", substeps) <= 1000000 or horizon is not None and whole("horizon", horizon) < 1:
            raise ValueError(f"expected 1 to 1000000 substeps and a horizon of 1 or more, found {substeps} and {horizon}")
        first = scene if isinstance(scene, World) else load(scene, settings)
        self.worlds = [first] + [first.copy() for _ in range(n - 1)]
        self.n, self.substeps = n, substeps
        self.finger_count, self.object_count = len(first.fingers), len(first.objects)
        self.horizon = horizon or max(1, round(first.duration / (first.dt * substeps)))
        self._begin = first.save()
        self._rotations = first.tracked_poses[:, 3:].copy()
        self._ids = numpy.array([w._handle.id for w in self.worlds], dtype=numpy.int64)
        self.random = numpy.random.default_rng()
        self.count = 0
        per_finger, per_object = [(_BONES, 7), (_NET, 3), (_TORQUES, 3), (_CONTACT_AREAS, 1)], [(_OBJECT_POSES, 7), (_OBJECT_MOTIONS, 6)]
        parts = [(field, width, self.finger_count) for field, width in per_finger]
        parts += [(field, width, self.object_count) for field, width in per_object]
        self.observation_size = sum(width * rows for _, width, rows in parts)
        self._sources, at = [], 0
        for field, width, rows in parts:
            views = [w._view(field, -1).reshape(-1) for w in self.worlds]
            self._sources.append((slice(at, at + width * rows), views))
            at += width * rows
        self.observations = numpy.zeros((n, self.observation_size))
        self._changes = [w._changes for w in self.worlds]

    def _observe(self):
        if [w._changes for w in self.worlds] != self._changes:
            raise Error(-6, "fingers, objects or thimbles of a world have come or gone: make another vector of it")
        for part, views in self._sources:
            if part.start != part.stop:
                numpy.stack(views, out=self.observations[:, part])
        return self.observations

    def field(self, name):
        """One part of the observations [n, rows, width]: bones, forces, torques, areas, objects, motions."""
        place = ["bones", "forces", "torques", "areas", "objects", "motions"].index(name)
        part = self._sources[place][0]
        rows = self.finger_count if place < 4 else self.object_count
        return self.observations[:, part].reshape(self.n, rows, -1)

    def start(self):
        """What a reset does to the fresh worlds; self.random is seeded. Does nothing."""

    def reward(self):
        """Rewards [n] of what self.observations show: 0."""
        return numpy.zeros(self.n)

    def terminated(self):
        """Which worlds have come to their end [n]: none."""
        return numpy.zeros(self.n, dtype=bool)

    def reset(self, seed=None):
        """All worlds as they began. Returns observations, {}."""
        if seed is not None:
            self.random = numpy.random.default_rng(seed)
        for world in self.worlds:
            world.restore(self._begin)
        self.count = 0
        self.start()
        return self._observe(), {}

    def act(self, actions):
        """Sets the tracked poses [n, fingers, 3 or 7] of the next steps."""
        actions = numpy.asarray(actions, dtype=numpy.float64)
        if actions.ndim != 3 or actions.shape[:2] != (self.n, self.finger_count) or actions.shape[2] not in (3, 7):
            raise ValueError(f"actions: expected [{self.n}, {self.finger_count}, 3 or 7], found {list(actions.shape)}")
        poses = numpy.empty((self.n, self.finger_count, 7))
        poses[:, :, 3:] = self._rotations
        poses[:, :, : actions.shape[2]] = actions
        set_pose, at = library.palpate_set_finger_pose, poses.ctypes.data
        for id in self._ids.tolist():
            for finger in range(self.finger_count):
                check(set_pose(id, finger, at))
                at += 56

    def step(self, actions=None):
        """One action in every world; None: fingers go on as they did. Returns observations, rewards, terminated,
        truncated, {}; each [n, ...]."""
        if actions is not None:
            self.act(actions)
        check(library.palpate_step_many(self._ids.ctypes.data, self.n, self.substeps))
        self.count += 1
        observations = self._observe()
        return observations, self.reward(), self.terminated(), numpy.full(self.n, self.count >= self.horizon), {}

    def __len__(self):
        return self.n

    def __repr__(self):
        return f"<{self.n} palpate worlds, {self.observation_size} observations each>"


def vector(scene, n, settings=(), substeps=1, horizon=None):
    """n worlds of one scene that are stepped together: see Vector."""
    return Vector(scene, n, settings, substeps, horizon)
