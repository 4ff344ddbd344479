"""Finds Young's modulus from a force: the finger is pressed 1 mm deep, and what it should push back with is given.

    python3 tune_stiffness.py [FORCE_N]     the secant method on logarithms, from 20 and 40 kPa
"""
import math
import sys

import palpate

SCENE = """
dt_ms = 5
[solver]
static = true
[[object]]
kind = "plane"
[[finger]]
name = "index"
finger = "index-median"
elements = 300
track = [ { t_s = 0, position_mm = [0, 0, 10] } ]
"""
world = palpate.load_text(SCENE)
finger = world.fingers["index"]
lowest = finger.nodes[:, 2].min()  # of the skin at rest, 10 mm above the plane
begin = world.save()


def force_of(young_kPa):
    world.set("finger.index.material.young_kPa=%.9g" % young_kPa)
    finger.pose = [0, 0, 0.010 - lowest - 0.001, 1, 0, 0, 0]
    world.step(10)
    force = finger.force[2]
    finger.pose = [0, 0, 0.010, 1, 0, 0, 0]  # and away again
    world.step(10)
    return force


wanted = float(sys.argv[1]) if len(sys.argv) > 1 else 0.55
x, force = [math.log(20), math.log(40)], [force_of(20), force_of(40)]
for _ in range(12):
    slope = (math.log(force[-1]) - math.log(force[-2])) / (x[-1] - x[-2])
    x.append(x[-1] + (math.log(wanted) - math.log(force[-1])) / slope)
    force.append(force_of(math.exp(x[-1])))
    print(f"{math.exp(x[-1]):8.3f} kPa: {force[-1]:.5f} N")
    if abs(force[-1] / wanted - 1) < 1e-4:
        break
else:
    sys.exit("not found")
