"""Presses a finger and reads its forces while it goes on: python3 read_forces.py [SCENE]"""
import sys

import numpy

import palpate

world = palpate.load(sys.argv[1] if len(sys.argv) > 1 else "press")
finger = world.fingers[0]
forces, touches = finger.forces, finger.touches  # views: every step fills them anew
print("  time s  force N  area mm2  touching  largest kPa")
while world.time < min(world.duration, 0.5) - 1e-9:
    world.step(10)
    print(f"{world.time:8.3f} {numpy.linalg.norm(forces.sum(axis=0)):8.4f} {1e6 * finger.area:9.2f} {touches.sum():9d} "
          f"{1e-3 * finger.pressures.max():12.2f}")  # fmt: skip
