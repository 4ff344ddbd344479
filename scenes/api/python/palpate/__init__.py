"""Feel virtual objects with several fingers at once.

    import palpate
    world = palpate.load("press")                   # a scene file, or one that comes with palpate
    world.fingers["index"].pose = [0, 0, 0.006, 1, 0, 0, 0]
    world.step(100)
    print(world.fingers["index"].forces)            # [samples, 3] N, a view: newest after every step

Units are SI: m, N, Pa, kg, s, rad. A pose is 7 numbers: position x y z, rotation as a unit quaternion w x y z, from the
finger's or object's own frame to the world. Arrays are read-only views of palpate's memory, which every step fills anew:
copy what you want to keep. One thread at a time steps a world; poses may be set, and snapshots read, from any thread.
"""
from ._library import BusyError, Error, SceneError, library
from ._parts import Finger, Object, Thimble
from ._vector import Vector, vector
from ._worlds import World, build, load, load_text, replay

__version__ = library.palpate_version().decode()
__all__ = ["load", "load_text", "build", "replay", "vector", "World", "Finger", "Object", "Thimble", "Vector", "Error",
           "SceneError", "BusyError"]  # fmt: skip
for _name in __all__:  # where they are, for whoever reads a message or asks for help
    globals()[_name].__module__ = "palpate"
del _name
