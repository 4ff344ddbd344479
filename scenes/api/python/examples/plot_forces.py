"""Plots what fingers feel: python3 plot_forces.py [SCENE] [FILE.png]

With Debian's python3-matplotlib; where it is missing it writes the same numbers as a table, FILE.csv."""
import sys

import numpy

import palpate

scene = sys.argv[1] if len(sys.argv) > 1 else "press"
file = sys.argv[2] if len(sys.argv) > 2 else "forces.png"
world = palpate.load(scene)
times, forces, areas = [], [], []
while world.time < min(world.duration, 1) - 1e-9:
    world.step(max(1, round(0.005 / world.dt)))
    times.append(world.time)
    forces.append(numpy.linalg.norm(world.forces, axis=1))
    areas.append(1e6 * world.areas)
names = world.fingers.keys()
try:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
except ImportError:
    file = file.rsplit(".", 1)[0] + ".csv"
    header = ",".join(["time_s", *(f"{n}_force_N" for n in names), *(f"{n}_area_mm2" for n in names)])
    numpy.savetxt(file, numpy.column_stack([times, forces, areas]), delimiter=",", header=header, comments="")
else:
    figure, (upper, lower, pad) = pyplot.subplots(1, 3, figsize=(12, 3.5))
    for plot, rows, label in ((upper, forces, "force [N]"), (lower, areas, "contact area [mm2]")):
        plot.plot(times, rows, label=names)
        plot.set_xlabel("time [s]"), plot.set_ylabel(label)
    upper.legend()
    finger = max(world.fingers, key=lambda f: numpy.linalg.norm(f.force))
    seen = pad.scatter(*(1e3 * finger.positions[:, :2].T), c=1e-3 * finger.pressures)
    pad.set_aspect("equal"), pad.set_title(f"pressure under {finger.name} [kPa], places in mm")
    figure.colorbar(seen, ax=pad)
    figure.tight_layout()
    figure.savefig(file)
print(file)
