"""A pinch as a task for learning: thumb and index lift a cube. With a scripted baseline, and steps a second.

    python3 pinch.py                    the baseline in 4 worlds
    python3 pinch.py --speed 1,64       steps a second of so many worlds together
"""
import argparse
import time

import numpy

import palpate


class Pinch(palpate.Vector):
    """Reward: height of the cube above where it began, 1 is 10 mm, less what it has turned."""

    def __init__(self, n):
        super().__init__("pinch", n, settings=["solver.preset=fast"], substeps=5, horizon=80)
        self.fingers = self.worlds[0].tracked_poses[:, :3].copy()
        self.cube = self.worlds[0].objects["cube"].index
        self.begin = self.worlds[0].objects[self.cube].pose.copy()

    def start(self):
        self.height = self.random.uniform(0.02, 0.03, self.n)  # that is asked for, of each world

    def grip(self, close, lift):
        """Positions [n, fingers, 3] of fingers that close towards the cube and lift."""
        positions = numpy.repeat(self.fingers[None], self.n, axis=0)
        inwards = self.begin[:3] - self.fingers
        inwards[:, 2] = 0
        inwards /= numpy.linalg.norm(inwards, axis=1)[:, None]
        positions += numpy.asarray(close)[:, None, None] * inwards
        positions[:, :, 2] += numpy.asarray(lift)[:, None]
        return positions

    def reward(self):
        cubes = self.field("objects")[:, self.cube]
        return (cubes[:, 2] - self.begin[2]) / 0.010 - numpy.linalg.norm(cubes[:, 4:7], axis=1)


def baseline(task):
    """Close, then lift. Returns how high the cubes are in the end [m]."""
    task.reset(seed=1)
    truncated = numpy.zeros(task.n, dtype=bool)
    count = 0
    while not truncated.all():
        close = min(1.0, count / 16) * 0.0075
        lift = min(1.0, max(0, count - 24) / 24) * task.height
        _, rewards, _, truncated, _ = task.step(task.grip(numpy.full(task.n, close), lift))
        count += 1
    return rewards, task.field("objects")[:, task.cube, 2] - task.begin[2]


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--worlds", type=int, default=4)
    parser.add_argument("--speed", default="")
    arguments = parser.parse_args()
    if arguments.speed:
        for n in map(int, arguments.speed.split(",")):
            task = Pinch(n)
            repeats, rounds, spent = max(1, 64 // n), 20, 0
            for _ in range(repeats):
                task.reset(seed=1)
                begin = time.perf_counter()
                for k in range(rounds):
                    task.step(task.grip(numpy.full(n, min(0.0075, 0.0005 * k)), numpy.zeros(n)))
                spent += time.perf_counter() - begin
            print(f"{n:5d} worlds: {n * repeats * rounds * task.substeps / spent:9.0f} steps of the simulation a second")
    else:
        rewards, heights = baseline(Pinch(arguments.worlds))
        for reward, height in zip(rewards, heights):
            print(f"lifted by {1e3 * height:.2f} mm, reward {reward:.3f}")
