"""A psychophysics staircase: python3 staircase.py [--trials 24] [--seed 1] [--plot staircase.png]

How much stiffer must a surface be than another one for an observer to feel it? Two surfaces are pressed with the same
force, one after the other; the observer says which is stiffer by the skin's contact area and indentation, with the noise
that hands have. Right twice in a row makes the difference smaller, wrong once makes it larger (two down, one up: 71 % right,
Levitt 1971); the threshold is the mean over the last reversals. Put a person in the observer's place."""
import argparse

import numpy

import palpate

SCENE = """
dt_ms = 2
duration_s = 100
[solver]
preset = "fast"
[[object]]
name = "surface"
kind = "plane"
stiffness_kPa_per_mm = 20
[[finger]]
name = "index"
elements = 200
track = [ { t_s = 0, position_mm = [0, 0, 9] } ]
"""


class Surface:
    """Pressed by a finger until it bears a force; remembers what it has felt: the world is put back, not made anew."""

    def __init__(self, target=0.5):
        self.world, self.target, self.felt = palpate.load_text(SCENE), target, {}
        self.start = self.world.save()

    def press(self, stiffness):
        """(indentation mm, contact area mm2) at the target force on a surface of `stiffness` [kPa/mm]."""
        key = round(stiffness, 2)
        if key not in self.felt:
            world, finger, z = self.world, self.world.fingers[0], 0.009
            world.restore(self.start)
            world.set(f"object.surface.stiffness_kPa_per_mm={key}")
            while finger.force[2] < self.target and z > -0.01:
                z -= 0.00005
                finger.pose = [0, 0, z, 1, 0, 0, 0]
                world.step(2)
            self.felt[key] = (1e3 * (0.009 - z), 1e6 * finger.area)
            world.set("object.surface.stiffness_kPa_per_mm=20")
        return self.felt[key]


def staircase(trials=24, seed=1, standard=20.0, noise_mm=0.02):
    """[(difference %, right)] of all trials, and the threshold [%]."""
    random, surface = numpy.random.default_rng(seed), Surface()
    difference, step, run, falling, reversals, told = 60.0, 1.5, 0, None, [], []
    for _ in range(trials):
        standard_mm, _ = surface.press(standard)
        stiffer_mm, _ = surface.press(standard * (1 + difference / 100))
        felt = numpy.array([standard_mm, stiffer_mm]) + random.normal(0, noise_mm, 2)
        right = bool(felt[1] < felt[0])  # a stiffer surface gives way less
        told.append((difference, right))
        run = run + 1 if right else 0
        if right and run < 2:
            continue
        if falling is not None and falling != right:
            reversals.append(difference)
        falling, run = right, 0
        difference = max(1.0, difference / step if right else difference * step)
    return told, float(numpy.mean(reversals[-6:])) if reversals else difference


if __name__ == "__main__":
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--trials", type=int, default=24)
    arguments.add_argument("--seed", type=int, default=1)
    arguments.add_argument("--plot")
    given = arguments.parse_args()
    told, threshold = staircase(given.trials, given.seed)
    print("trial  stiffer by  said")
    for k, (difference, right) in enumerate(told):
        print(f"{k + 1:5d} {difference:9.1f} %  {'right' if right else 'wrong'}")
    print(f"threshold {threshold:.1f} %")
    if given.plot:
        from matplotlib import pyplot  # Debian's python3-matplotlib

        pyplot.step(range(1, len(told) + 1), [d for d, _ in told], where="mid")
        pyplot.axhline(threshold, linestyle="--")
        pyplot.xlabel("trial"), pyplot.ylabel("stiffer by [%]")
        pyplot.savefig(given.plot)
