"""The Python package as its users see it: python_test.py PROGRAM (with PYTHONPATH and PALPATE_LIBRARY set)."""
import copy
import gc
import json
import multiprocessing
import os
import pathlib
import pickle
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import xml.etree.ElementTree

import numpy

import palpate

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = sys.argv.pop(1) if len(sys.argv) > 1 else str(ROOT / "build/release/palpate")
SMALL = """
duration_s = 0.1
dt_ms = 1
[solver]
preset = "balanced"
[[object]]
name = "table"
kind = "plane"
friction = 0.5
[[finger]]
name = "index"
elements = 120
device = { kind = "chinello-3rrs" }
track = [ { t_s = 0, position_mm = [0, 0, 10] }, { t_s = 0.05, position_mm = [0, 0, 6] } ]
"""


def stepped(world):
    """In another process."""
    world.step(30)
    palpate.vector(world, 2).step()
    return world.fingers[0].force.tolist()


class Palpate(unittest.TestCase):
    def test_views_are_live_and_read_only_and_keep_the_world(self):
        world = palpate.load_text(SMALL)
        finger = world.fingers["index"]
        forces = finger.forces
        self.assertEqual(forces.shape, finger.positions.shape)
        self.assertEqual((len(forces),), finger.pressures.shape)
        self.assertEqual(0, numpy.abs(forces).sum())
        world.step(60)
        self.assertGreater(forces[:, 2].sum(), 0.05)
        numpy.testing.assert_allclose(forces.sum(axis=0), finger.force, atol=1e-12)
        self.assertTrue(numpy.isfinite(finger.centre).all())
        self.assertGreater(finger.area, 0)
        self.assertEqual(finger.touches.dtype, numpy.uint8)
        self.assertEqual(finger.faces.shape[1], 3)
        self.assertLess(finger.stretches[:, 0].min(), 1)
        self.assertEqual(1, finger.state.converged)
        with self.assertRaises(ValueError):
            forces[0, 0] = 1
        kept = forces.copy()
        del world, finger
        gc.collect()
        numpy.testing.assert_array_equal(kept, forces)

    def test_poses_and_thimbles(self):
        world = palpate.load_text(SMALL)
        finger = world.fingers[0]
        finger.pose = [0.001, 0, 0.006, 1, 0, 0, 0]
        world.step(100)
        numpy.testing.assert_allclose(finger.pose[:3], [0.001, 0, 0.006])
        numpy.testing.assert_allclose(finger.bone[:3], [0.001, 0, 0.006], atol=1e-3)
        self.assertIs(finger.thimble, world.thimbles[0])
        self.assertGreater(numpy.abs(finger.thimble.sent).sum(), 0)
        finger.pose = None
        world.step(10)
        self.assertAlmostEqual(0.010, finger.state.silent)
        world.objects["table"].pose = [0, 0, -0.02, 1, 0, 0, 0]
        world.step(5)
        self.assertEqual(0, finger.area)

    def test_steps_are_whole_numbers_that_fit(self):
        world = palpate.load_text(SMALL)
        world.step(numpy.int64(2))
        for wrong in (2**32 + 5, -(2**40), 0, 1.5, "1", None):
            with self.assertRaises((ValueError, palpate.Error, TypeError)):
                world.step(wrong)
        self.assertEqual(2, world.steps)

    def test_what_is_wrong_is_said(self):
        world = palpate.load_text(SMALL)
        with self.assertRaisesRegex(KeyError, "there are: index"):
            world.fingers["thumb"]
        with self.assertRaisesRegex(palpate.SceneError, "scene:1:"):
            palpate.load_text("duration_s = -1")
        with self.assertRaisesRegex(ValueError, "7 numbers"):
            world.fingers[0].pose = [1, 2, 3]
        with self.assertRaisesRegex(palpate.Error, "finite"):
            world.fingers[0].pose = [numpy.nan, 0, 0, 1, 0, 0, 0]
        with self.assertRaisesRegex(ValueError, "step in parts"):
            world.step(2**31 - 1)
        with self.assertRaisesRegex(palpate.Error, "new world"):
            world.set("finger.index.elements=300")

    def test_mistakes_are_not_swallowed(self):
        """What users mistype or compute: an exception that says so each time, and the world goes on."""
        world = palpate.load_text(SMALL)
        finger, table = world.fingers[0], world.objects[0]
        pose = [0.1, 0.1, 0.1, 1, 0, 0, 0]
        wrong = {
            "poes": lambda: setattr(finger, "poes", pose),
            "tme": lambda: setattr(world, "tme", 3),
            "must be real": lambda: setattr(finger, "pose", "abcdefg"),
            "rotation": lambda: setattr(finger, "pose", numpy.zeros(7)),
            "NoneType": lambda: setattr(table, "pose", None),
            "interpreted as an integer": lambda: world.step(2.0),
            "there are: plane, box": lambda: world.add_object("cube"),
            "edge lengths": lambda: world.add_object("box"),
            "found nan": lambda: world.add_object("sphere", [numpy.nan], pose=pose),
            "from 0.001 to 1e\\+06 g": lambda: world.add_object("sphere", [0.01], pose=pose, mass=numpy.inf),
            "from 20 to 200000": lambda: world.add_finger("x", elements=-3, pose=pose),
            "too many": lambda: world.add_finger("x", elements=2**40, pose=pose),
            "a name is used for files": lambda: world.add_finger('a"b', elements=120, pose=pose),
            "no zero": lambda: world.add_finger("a\0b", elements=120, pose=pose),
            "already": lambda: world.add_finger("index", elements=120, pose=pose),
            "nosuch.obj": lambda: world.add_object("mesh", file="nosuch.obj", pose=pose),
            "thumb-small": lambda: world.add_finger(finger="toe", pose=pose),
            "chinello-3rrs": lambda: setattr(finger, "thimble", "nope"),
            "did you mean": lambda: world.set("finger.index.material.yung_kPa=40"),
            "key=value": lambda: world.set("abc"),
            "three numbers": lambda: palpate.build([{}], gravity=(0, 0)),
            "at least one": lambda: palpate.build([]),
            "one world": lambda: palpate.vector(world, 0),
            "no saved state": lambda: world.restore(b"abc"),
            "nowhere": lambda: world.record("/nowhere/run.palpate"),
        }
        for said, call in wrong.items():
            with self.assertRaisesRegex(Exception, said):
                call()
        self.assertEqual((1, 1, 0), (len(world.fingers), len(world.objects), world.steps))
        world.step()
        self.assertEqual(2e-3, palpate.load_text(SMALL, settings={"dt_ms": 2}).dt)

    def test_processes(self):
        """Forked while a pool of threads is there, and spawned ones that get worlds as pickles."""
        task = palpate.vector(palpate.load_text(SMALL), 4)
        task.step()
        task.worlds[0].step(30)
        for kind in ("fork", "spawn"):
            with multiprocessing.get_context(kind).Pool(2) as pool:
                forces = pool.map_async(stepped, [task.worlds[0], task.worlds[1]]).get(timeout=120)
            expected = [world.copy() for world in task.worlds[:2]]
            self.assertEqual([stepped(world) for world in expected], forces)
            self.assertGreater(forces[0][2], 0)

    def test_one_thread_steps_at_a_time(self):
        world = palpate.load_text(SMALL)
        done, busy = [], []

        def steps():
            for _ in range(100):
                try:
                    world.step()
                    done.append(1)
                except palpate.BusyError as error:
                    busy.append(str(error))

        threads = [threading.Thread(target=steps) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(len(done), world.steps)
        self.assertEqual(300, len(done) + len(busy))
        self.assertTrue(all("one owner at a time" in text for text in busy))

    def test_worlds_from_descriptions(self):
        world = palpate.build([{"name": "index", "elements": 120, "pose": [0, 0, 0.006, 1, 0, 0, 0]}], [{"shape": "plane", "friction": 0.5}])
        again = palpate.load_text(world.scene)
        for one in (world, again):
            one.keep_frames(100)
            one.step(50)
        self.assertGreater(world.fingers["index"].force[2], 0.05)
        numpy.testing.assert_array_equal(world.fingers["index"].nodes, again.fingers["index"].nodes)
        self.assertTrue(re.search(r"0\.05 s in steps of 1 ms, [0-9.]+ % of them converged; 6 frames shown", world.report()))
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "report.html"
            self.assertIsNone(world.report(file))
            self.assertTrue(file.read_text().startswith("<!DOCTYPE html>"))
        world.step(50)  # the press has come to rest
        self.assertRegex(repr(world.fingers[0].state), "converged=1")

    def test_the_same_bits_as_the_program(self):
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "run.palpate"
            scene = pathlib.Path(folder) / "small.toml"
            scene.write_text(SMALL)
            subprocess.run([PROGRAM, "run", scene, "--quiet", "--no-picture", "--record", file, "--out", pathlib.Path(folder) / "out"], check=True)
            world, again = palpate.load(scene), palpate.replay(file)
            while again.replayed.done < again.replayed.steps:
                again.step()
                world.step()
                for name in ("nodes", "forces"):
                    numpy.testing.assert_array_equal(getattr(again.fingers[0], name), getattr(world.fingers[0], name))
                numpy.testing.assert_array_equal(again.thimbles[0].sent, world.thimbles[0].sent)
            self.assertEqual((1, 100), (again.replayed.same, again.replayed.done))

    def test_copies_and_pickles_go_on_alike(self):
        world = palpate.load_text(SMALL, settings=["finger.index.material.young_kPa=20"])
        world.step(40)
        state = world.save()
        others = [copy.deepcopy(world), pickle.loads(pickle.dumps(world))]
        world.step(40)
        expected = world.fingers[0].nodes.copy()
        world.restore(state)
        for other in others + [world]:
            other.step(40)
            numpy.testing.assert_array_equal(expected, other.fingers[0].nodes)
        self.assertEqual(["finger.index.material.young_kPa=20"], others[1].settings)

    def test_damaged_states_are_refused(self):
        world = palpate.load_text(SMALL)
        world.fingers[0].pose = [0, 0, 0.007, 1, 0, 0, 0]
        world.step(20)
        before, state = world.fingers[0].nodes.copy(), bytearray(world.save())
        places = [*range(0, 140, 3), *range(140, len(state), max(1, len(state) // 100))]  # poses that were set, and the rest
        for place in places:
            state[place] ^= 1
            with self.assertRaises(palpate.SceneError, msg=f"byte {place}"):
                world.restore(bytes(state))
            state[place] ^= 1
        self.assertTrue((before == world.fingers[0].nodes).all())
        world.restore(bytes(state))

    def test_a_vector_says_where_its_worlds_have_changed(self):
        task = palpate.vector(palpate.load_text(SMALL), 2)
        task.step()
        task.worlds[0].add_object("sphere", [0.01], pose=[0.2, 0, 0.1, 1, 0, 0, 0])
        with self.assertRaisesRegex(palpate.Error, "another vector"):
            task.step()
        for wrong in ({"substeps": 0}, {"substeps": 2**32 + 1}, {"horizon": 0}, {"n": 0}):
            with self.assertRaises(ValueError, msg=wrong):
                palpate.vector(task.worlds[1], **{"n": 1, **wrong})

    def test_settings_change_while_it_runs(self):
        world = palpate.load_text(SMALL)
        world.step(90)
        forces = world.fingers[0].forces
        before = forces[:, 2].sum()
        world.set("finger.index.material.young_kPa=5")
        world.step(60)
        self.assertLess(forces[:, 2].sum(), 0.7 * before)

    def test_fingers_and_objects_come_and_go(self):
        world = palpate.load("press", settings=["dt_ms=1", "solver.preset=balanced"])
        alone = world.copy()
        forces, finger = world.fingers["index"].forces, world.fingers["index"]
        world.step(50)
        thumb = world.add_finger("thumb", pose=[-0.06, 0, 0.02, 1, 0, 0, 0], elements=120)
        ball = world.add_object("sphere", [0.01], pose=[0, 0.1, 0.05, 1, 0, 0, 0], mass=0.01)
        self.assertEqual(["index", "thumb"], world.fingers.keys())
        self.assertIs(finger, world.fingers["index"])
        thumb.pose = [-0.06, 0, 0.006, 1, 0, 0, 0]
        world.step(50)
        alone.step(100)
        self.assertEqual((2, 3), world.forces.shape)
        self.assertGreater(thumb.force[2], 0.02)
        self.assertLess(ball.pose[2], 0.05)
        self.assertTrue(numpy.array_equal(alone.fingers[0].forces, forces))
        held = thumb.forces
        before = held.copy()
        thumb.thimble = "chinello-3rrs"
        self.assertEqual("chinello-3rrs", thumb.thimble.kind)
        thumb.thimble = None
        self.assertIsNone(thumb.thimble)
        thumb.remove()
        world.step()
        self.assertTrue(numpy.array_equal(before, held))  # memory that stays
        for wrong in (lambda: thumb.force, lambda: thumb.forces, thumb.remove, lambda: world.fingers[0].remove()):
            with self.assertRaises(palpate.Error):
                wrong()
        again = pickle.loads(pickle.dumps(world))
        again.step(10)
        world.step(10)
        self.assertTrue(numpy.array_equal(again.objects[ball.name].pose, ball.pose))

    def test_soft_objects(self):
        world = palpate.build([{"name": "index", "elements": 120, "pose": [0, 0, 0.020, 1, 0, 0, 0]}],
                              [{"shape": "plane", "name": "table"},
                               {"shape": "box", "name": "cushion", "dimensions": [0.024, 0.024, 0.012], "pose": [0, 0, 0.006, 1, 0, 0, 0],
                                "friction": 0.5, "young_modulus": 1e4, "elements": 300}])  # fmt: skip
        cushion, finger = world.objects["cushion"], world.fingers[0]
        places = cushion.positions
        begin = places.copy()
        finger.pose = [0, 0, 0.0165, 1, 0, 0, 0]
        world.step(200)
        self.assertEqual((1, 0), (cushion.state.soft, cushion.state.moves))
        self.assertGreater(numpy.abs(places - begin).max(), 1e-4)  # a view: the newest
        self.assertLess(cushion.force[2], -0.02)
        numpy.testing.assert_allclose(cushion.force, -finger.force, atol=1e-12)
        numpy.testing.assert_allclose(cushion.forces.sum(axis=0), cushion.force, atol=1e-12)
        numpy.testing.assert_allclose(finger.forces_by_object, [[0, 0, 0], finger.force], atol=1e-12)
        numpy.testing.assert_allclose(places, cushion.nodes[cushion.sample_nodes], atol=1e-9)
        self.assertEqual((len(cushion.tetrahedra), 2), cushion.stretches.shape)
        self.assertTrue((cushion.pressures >= 0).all() and cushion.touches.any())
        with self.assertRaisesRegex(palpate.Error, "rigid"):
            world.objects["table"].positions
        again = pickle.loads(pickle.dumps(world))
        again.step(5)
        world.step(5)
        self.assertTrue((again.objects["cushion"].nodes == cushion.nodes).all())
        world.add_object("sphere", [0.01], pose=[0.2, 0, 0.1, 1, 0, 0, 0])
        self.assertEqual((3, 3), finger.forces_by_object.shape)
        cushion.remove()
        with self.assertRaisesRegex(palpate.Error, "removed"):
            cushion.nodes

    def test_an_interrupt_ends_many_steps(self):
        world = palpate.load_text(SMALL)
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        begin = time.monotonic()
        with self.assertRaises(KeyboardInterrupt):
            world.step(1000000)
        self.assertLess(time.monotonic() - begin, 20)
        done = world.steps
        self.assertTrue(0 < done < 1000000)
        world.step_to(world.time + 0.1)
        self.assertEqual(done + 100, world.steps)

    def test_threads(self):
        world = palpate.load_text(SMALL)
        world.keep_snapshots()
        seen, done = [], threading.Event()

        def watch():
            while not done.is_set():
                state, positions, forces = world.fingers[0].snapshot()
                seen.append(abs(forces[:, 2].sum() - state.force[2]))
                time.sleep(0)

        watcher = threading.Thread(target=watch)
        watcher.start()
        for _ in range(300):
            world.step()
        done.set()
        watcher.join()
        self.assertLess(max(seen), 1e-12)

    def test_vector(self):
        task = palpate.vector(palpate.load_text(SMALL), 3, substeps=2)
        observations, _ = task.reset(seed=3)
        self.assertEqual((3, task.observation_size), observations.shape)
        actions = numpy.zeros((3, 1, 3))
        actions[:, 0, 2] = [0.010, 0.007, 0.006]
        for _ in range(50):
            observations, rewards, terminated, truncated, _ = task.step(actions)
        self.assertTrue(truncated.all() and not terminated.any() and rewards.shape == (3,))
        forces = task.field("forces")[:, 0, 2].copy()
        self.assertEqual(0, forces[0])
        self.assertLess(forces[1], forces[2])
        task.reset(seed=3)
        for _ in range(50):
            task.step(actions)
        numpy.testing.assert_array_equal(forces, task.field("forces")[:, 0, 2])
        with self.assertRaisesRegex(ValueError, "expected"):
            task.step(numpy.zeros((2, 1, 3)))

    def test_reprs(self):
        world = palpate.load_text(SMALL)
        for thing in (world, world.fingers, world.fingers[0], world.objects[0], world.thimbles[0]):
            self.assertRegex(repr(thing), "^<")
        world.fingers[0].pose = [0, 0, 0.006, 1, 0, 0, 0]
        world.step(60)
        html, _, frame = world._repr_html_().partition("<iframe")
        xml.etree.ElementTree.fromstring(f"<div>{html.replace('&sup2;', '')}</div>")  # well formed
        self.assertIn("1 frames shown", frame)
        self.assertEqual(4, frame.count("'"))  # nothing in the page ends its attribute
        self.assertIn("index", html)
        self.assertEqual(len(world.fingers[0].faces), html.count("<polygon"))
        self.assertGreater(len(set(re.findall(r"rgb\([^)]*\)", html))), 3)

    def test_examples(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        plot = f"plot_forces.py press {scratch.name}/forces.png"
        for line in ("read_forces.py", "tune_stiffness.py 0.6", "pinch.py --worlds 2", plot, "hold_force.py", "staircase.py --trials 10"):
            ran = subprocess.run([sys.executable, *line.split()], cwd=ROOT / "scenes/api/python/examples", capture_output=True, text=True)
            self.assertEqual(0, ran.returncode, line + ran.stderr)
            if line.startswith("hold_force"):
                self.assertLess(float(ran.stdout.split(" within ")[1].split()[0]), 0.1, ran.stdout)
            if line.startswith("pinch"):
                for lifted in ran.stdout.splitlines():
                    self.assertGreater(float(lifted.split()[2]), 15, ran.stdout)

        self.assertTrue(list(pathlib.Path(scratch.name).glob("forces.*")))
        self.assertRegex(ran.stdout, r"threshold \d+\.\d %")

    def test_the_notebook(self):
        """Its cells, one after the other; in a kernel of Jupyter, too, where that is installed."""
        file = ROOT / "scenes/api/python/examples/finger.ipynb"
        names = {}
        for cell in json.loads(file.read_text())["cells"]:
            if cell["cell_type"] == "code":
                exec(compile("".join(cell["source"]), str(file), "exec"), names)
        if subprocess.run([sys.executable, "-c", "import nbconvert, ipykernel"], capture_output=True).returncode == 0:
            scratch = tempfile.TemporaryDirectory()
            self.addCleanup(scratch.cleanup)
            convert = [sys.executable, "-m", "nbconvert", "--to", "html", "--execute", "--output-dir", scratch.name, str(file)]
            ran = subprocess.run(convert, capture_output=True, text=True)
            self.assertEqual(0, ran.returncode, ran.stderr)
            page = next(pathlib.Path(scratch.name).glob("*.html")).read_text()
            self.assertIn("A finger on a table", page)
            self.assertIn("1 frames shown", page)  # the offline report, in its frame
            if subprocess.run([sys.executable, "-c", "import matplotlib"], capture_output=True).returncode == 0:
                self.assertIn("data:image/png", page)


if __name__ == "__main__":
    unittest.main()
