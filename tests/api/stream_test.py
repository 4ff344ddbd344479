"""The live stream as its readers see it: stream_test.py PROGRAM"""
import json
import pathlib
import re
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = sys.argv.pop(1)


def rows_of(folder):
    lines = (folder / "index.csv").read_text().splitlines()
    names = lines[0].split(",")
    return [dict(zip(names, map(float, line.split(",")))) for line in lines[1:]]


STREAMS = []


class WebSocket:
    """As little of RFC 6455 as a reader needs."""

    def __init__(self, address, origin=None):
        host, port, path = re.fullmatch(r"ws://([^:]+):(\d+)(/.*)", address).groups()
        self.s = socket.create_connection((host, int(port)), timeout=20)
        head = f"GET {path} HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        head += "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
        self.s.sendall((head + (f"Origin: {origin}\r\n" if origin else "") + "\r\n").encode())
        STREAMS.append(self.s)
        self.rest, answer = b"", b""
        while b"\r\n\r\n" not in answer:
            got = self.s.recv(4096)
            if not got:
                break
            answer += got
        answer, _, self.rest = answer.partition(b"\r\n\r\n")
        self.accepted = b" 101 " in answer

    def take(self, n):
        while len(self.rest) < n:
            got = self.s.recv(65536)
            if not got:
                raise EOFError
            self.rest += got
        taken, self.rest = self.rest[:n], self.rest[n:]
        return taken

    def read(self):
        """The next text; None: the other end has closed."""
        first, size = self.take(2)
        if size >= 126:
            size = int.from_bytes(self.take(2 if size == 126 else 8), "big")
        payload = self.take(size)
        return None if first & 15 == 8 else json.loads(payload)

    def say(self, **what):
        text = json.dumps(what).encode()
        self.s.sendall(bytes([0x81, 0x80 | len(text)]) + b"\0\0\0\0" + text)


class Stream(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = pathlib.Path(scratch.name) / "out"
        self.addCleanup(lambda: [STREAMS.pop().close() for _ in list(STREAMS)])

    def command(self, *arguments, duration="0.3"):
        return [PROGRAM, "run", str(ROOT / "scenes/press.toml"), "--set", "dt_ms=1", "--no-picture", "--duration", duration, "--threads", "1",
                "--out", str(self.folder), *arguments]  # fmt: skip

    def test_lines_say_what_the_results_say(self):
        ran = subprocess.run(self.command("--stream", "-"), capture_output=True, text=True, timeout=60)
        self.assertEqual(0, ran.returncode, ran.stderr)
        lines = [json.loads(line) for line in ran.stdout.splitlines()]
        rows = {round(row["time_s"], 6): row for row in rows_of(self.folder)}
        self.assertEqual(300, len(rows))
        self.assertGreater(len(lines), 30)  # others are left out where this machine is busy
        self.assertAlmostEqual(0.3, lines[-1]["time"])
        self.assertEqual(sorted(line["step"] for line in lines), [line["step"] for line in lines])
        for line in lines:
            row, finger = rows[round(line["time"], 6)], line["fingers"][0]
            self.assertEqual(1, line["palpate"])
            self.assertAlmostEqual(row["force_z_N"], finger["force"][2], places=4)
            self.assertAlmostEqual(row["bone_z_mm"], 1e3 * finger["pose"][2], places=3)
            self.assertEqual(row["touching_samples"], finger["touching"])
            self.assertEqual(finger["touching"] == 0, finger["centre"] is None)
            self.assertAlmostEqual(row["torque_y_Nm"], finger["torque"][1], places=9)
            if finger["centre"]:
                self.assertAlmostEqual(row["centre_z_mm"], 1e3 * finger["centre"][2], places=6)

    def test_lines_have_objects_and_what_presses_on_them(self):
        scene = self.folder.parent / "cushion.toml"
        scene.write_text("""
dt_ms = 2
[[object]]
name = "table"
kind = "plane"
[[object]]
name = "cushion"
kind = "box"
size_mm = [24, 24, 12]
position_mm = [60, 0, 6]
soft = { young_kPa = 10, elements = 300, fixed = "bottom" }
[[finger]]
name = "index"
elements = 120
track = [ { t_s = 0, position_mm = [60, 0, 20] }, { t_s = 0.04, position_mm = [60, 0, 17] } ]
""")
        command = [PROGRAM, "run", str(scene), "--no-picture", "--duration", "0.06", "--out", str(self.folder), "--stream", "-", "--stream-samples"]
        ran = subprocess.run(command, capture_output=True, text=True, timeout=60)
        self.assertEqual(0, ran.returncode, ran.stderr)
        lines = [json.loads(line) for line in ran.stdout.splitlines()]
        table, cushion = lines[-1]["objects"]
        self.assertEqual([0, 0, 0], table["force"])
        self.assertNotIn("samples", table)
        self.assertLess(cushion["force"][2], -0.02)
        for d in range(3):
            self.assertAlmostEqual(-lines[-1]["fingers"][0]["force"][d], cushion["force"][d], places=12)
            self.assertAlmostEqual(sum(f[d] for f in cushion["samples"]["forces"]), cushion["force"][d], places=6)
        before, after = (line["objects"][1]["samples"]["positions"] for line in (lines[0], lines[-1]))
        self.assertEqual(len(before), len(after))
        self.assertGreater(max(abs(b[2] - a[2]) for a, b in zip(after, before)), 1e-4)

    def test_who_does_not_read_does_not_slow_the_steps(self):
        begin = time.monotonic()
        ran = subprocess.Popen(self.command("--stream", "-", "--stream-samples", duration="2"), stdout=subprocess.PIPE)
        self.addCleanup(ran.stdout.close)
        self.assertEqual(0, ran.wait(timeout=60))  # nothing was read: 2,000 lines have no room in a pipe
        self.assertLess(time.monotonic() - begin, 30)
        self.assertEqual(2000, len(rows_of(self.folder)))

    def test_who_goes_away_ends_nothing(self):
        ran = subprocess.Popen(self.command("--stream", "-"), stdout=subprocess.PIPE)
        ran.stdout.readline()
        ran.stdout.close()
        self.assertEqual(0, ran.wait(timeout=60))
        self.assertEqual(300, len(rows_of(self.folder)))

    def udp(self):
        s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        s.bind(("127.0.0.1", 0))
        s.settimeout(20)
        self.addCleanup(s.close)
        return s, "udp:127.0.0.1:%d" % s.getsockname()[1]

    def test_commands_move_pause_and_are_recorded(self):
        s, target = self.udp()
        record = self.folder.parent / "run.palpate"
        ran = subprocess.Popen(self.command("--stream", target, "--record", str(record), duration="3"), stdout=subprocess.PIPE, text=True)
        line, palpate = s.recvfrom(65536)

        def say(**what):
            s.sendto(json.dumps(what).encode(), palpate)

        say(pause=True)
        s.settimeout(0.5)
        with self.assertRaises(socket.timeout):
            while True:
                line, palpate = s.recvfrom(65536)
        paused_at = json.loads(line)["time"]
        self.assertLess(paused_at, 2.9)
        say(finger="index", pose=[0.002, 0, 0.012, 1, 0, 0, 0])
        say(samples=True)
        say(finger="nobody", pose=None)
        say(pause=False)
        s.settimeout(20)
        seen = {}
        while seen.get("time", 0) < 2.99:  # a slow reader may miss the last lines
            try:
                seen = json.loads(s.recvfrom(65536)[0])
            except socket.timeout:
                break
            if seen["time"] > paused_at:
                s.settimeout(3)
        self.assertGreater(seen["time"], paused_at)
        finger = seen["fingers"][0]
        self.assertEqual([0.002, 0, 0.012, 1, 0, 0, 0], finger["tracked"])
        self.assertAlmostEqual(0.012, finger["pose"][2], places=4)
        self.assertEqual(len(finger["samples"]["positions"]), len(finger["samples"]["forces"]))
        said, _ = ran.communicate(timeout=60)
        self.assertIn("5 commands, 0 that", said)
        replayed = subprocess.run([PROGRAM, "replay", record], capture_output=True, text=True)
        self.assertEqual(0, replayed.returncode, replayed.stdout)

    def websocket_run(self, *arguments, duration="0.3", program=None):
        ran = subprocess.Popen(program or self.command("--quiet", "--stream", "websocket:0", "--stream-wait", *arguments,
                               duration=duration), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # fmt: skip
        self.addCleanup(ran.stdout.close)
        self.addCleanup(ran.stderr.close)
        self.addCleanup(ran.wait)
        self.addCleanup(ran.kill)
        for line in ran.stderr:
            if line.startswith("stream: "):
                return ran, line.split()[1]
        self.fail("no address")

    def test_websockets_read_and_command(self):
        ran, address = self.websocket_run(duration="1")
        s = WebSocket(address)
        lines = []
        while line := s.read():
            lines.append(line)
            if len(lines) == 1:
                s.say(pause=True)
                s.say(finger="index", pose=[0.002, 0, 0.012, 1, 0, 0, 0])
                s.say(samples=True)
                s.say(pause=False)
        self.assertEqual(0, ran.wait(timeout=60))
        self.assertGreater(len(lines), 50)
        self.assertAlmostEqual(1, lines[-1]["time"])  # to the end, in order, and closed as it should be
        self.assertEqual(sorted(line["step"] for line in lines), [line["step"] for line in lines])
        self.assertEqual([0.002, 0, 0.012, 1, 0, 0, 0], lines[-1]["fingers"][0]["tracked"])
        self.assertIn("samples", lines[-1]["fingers"][0])

    def test_websockets_need_the_token_and_a_page_of_this_machine(self):
        ran, address = self.websocket_run("--stream-token", "a-token-of-mine")
        self.assertTrue(address.endswith("/stream?token=a-token-of-mine"))
        for wrong in (address[:-1], address.replace("stream?", "other?"), address.split("?")[0]):
            self.assertFalse(WebSocket(wrong).accepted)
        self.assertFalse(WebSocket(address, origin="http://evil.example").accepted)
        self.assertFalse(WebSocket(address, origin="http://localhost.evil.example").accepted)
        self.assertIsNone(ran.poll())  # it still waits
        page = WebSocket(address, origin="http://localhost:8000")
        self.assertTrue(page.accepted)
        page.s.close()  # who goes away ends nothing
        self.assertEqual(0, ran.wait(timeout=60))
        self.assertEqual(300, len(rows_of(self.folder)))

    def test_websockets_that_do_not_read_do_not_slow_the_steps(self):
        ran, address = self.websocket_run("--stream-samples", duration="3")
        s = WebSocket(address)
        self.assertTrue(s.accepted)
        self.assertEqual(0, ran.wait(timeout=60))
        self.assertEqual(3000, len(rows_of(self.folder)))

    def test_websockets_that_read_slowly_miss_lines_but_not_the_last(self):
        ran, address = self.websocket_run("--stream-samples", duration="3")
        s = WebSocket(address)
        steps = []
        while line := s.read():
            steps.append(line["step"])
            time.sleep(0.01 if len(steps) < 300 else 0)
        self.assertEqual(0, ran.wait(timeout=60))
        self.assertEqual(sorted(set(steps)), steps)
        self.assertEqual(3000, steps[-1])
        self.assertLess(len(steps), 3000)

    def test_a_view_takes_settings_over_a_websocket(self):
        view, address = self.websocket_run(program=[PROGRAM, "view", str(ROOT / "scenes/press.toml"), "--port", "0", "--stream",
                                                    "websocket:0", "--stream-rate", "100"])  # fmt: skip
        s = WebSocket(address)
        before = s.read()
        s.say(finger="index", pose=before["fingers"][0]["tracked"])
        s.say(set=["solver.preset=fast"])
        s.say(set=["object.table.no_such_key=1"])  # refused, and said on the page
        for _ in range(20):
            after = s.read()
        self.assertGreater(after["step"], before["step"])

    def test_a_view_streams_and_obeys_too(self):
        s, target = self.udp()
        view = subprocess.Popen([PROGRAM, "view", str(ROOT / "scenes/press.toml"), "--port", "0", "--stream", target,
                                 "--stream-rate", "100"], stdout=subprocess.DEVNULL)  # fmt: skip
        try:
            line, palpate = s.recvfrom(65536)
            times = [json.loads(s.recv(65536))["time"] for _ in range(20)]
            self.assertAlmostEqual(0.01, (times[-1] - times[0]) / 19, places=2)  # 100 lines a simulated second
            s.sendto(json.dumps({"finger": "index", "pose": [0, 0, 0.03, 1, 0, 0, 0]}).encode(), palpate)
            seen = {"tracked": None}
            while seen["tracked"] != [0, 0, 0.03, 1, 0, 0, 0]:
                seen = json.loads(s.recv(65536))["fingers"][0]
            s.sendto(b'{"pause": true}', palpate)
            s.settimeout(0.5)
            with self.assertRaises(socket.timeout):
                while True:
                    s.recv(65536)
        finally:
            view.terminate()
            view.wait(timeout=20)

    def test_a_flood_of_nonsense_changes_nothing(self):
        s, target = self.udp()
        subprocess.run(self.command("--quiet"), check=True)
        expected = (self.folder / "index.csv").read_text()
        ran = subprocess.Popen(self.command("--stream", target), stdout=subprocess.PIPE, text=True)
        palpate = s.recvfrom(65536)[1]
        nonsense = [b"", b"{", b"[" * 60000, b"\xff" * 100, b'{"pause": 3}', b'{"finger": "index", "pose": [1]}', b'{"arm": true}',
                    b'{"finger": "index", "pose": [0, 0, NaN, 1, 0, 0, 0]}', b'{"object": 7, "pose": null}']  # fmt: skip
        ended = threading.Event()

        def flood():
            while not ended.is_set():
                for text in nonsense:
                    try:
                        s.sendto(text, palpate)
                    except OSError:
                        pass

        thread = threading.Thread(target=flood)
        thread.start()
        said, _ = ran.communicate(timeout=60)
        ended.set()
        thread.join()
        self.assertEqual(0, ran.returncode)
        self.assertRegex(said, r"; 0 commands, [1-9]\d* that could not be read")
        self.assertEqual(expected, (self.folder / "index.csv").read_text())

    def test_wrong_targets_are_said(self):
        for target in ("websocket:", "websocket:x", "websocket:70000"):
            ran = subprocess.run(self.command("--stream", target), capture_output=True, text=True)
            self.assertEqual(2, ran.returncode)
            self.assertIn("expected websocket:PORT", ran.stderr)
        ran = subprocess.run(self.command("--stream", "websocket:0", "--stream-token", "short"), capture_output=True, text=True)
        self.assertIn("--stream-token: expected 8", ran.stderr)
        for target in ("udp:5006", "tcp:127.0.0.1:5006", "udp:nowhere.invalid:1", "udp:127.0.0.1:none"):
            ran = subprocess.run(self.command("--stream", target), capture_output=True, text=True)
            self.assertEqual(2, ran.returncode)
            self.assertIn("expected udp:HOST:PORT", ran.stderr)


if __name__ == "__main__":
    unittest.main()
