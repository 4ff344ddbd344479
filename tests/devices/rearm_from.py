"""Plays a page of `palpate view --arm`, at ADDRESS, that asks to re-arm thimbles once it hears that they are in fault.

rearm_from.py ADDRESS OUTPUT: waits for the address that palpate prints into the file OUTPUT, first tries what must be refused
(no token, a wrong one, the page of another site), and prints what the program says to it."""
import json
import re
import socket
import sys
import time


def open_socket(address, port, path, origin=None):
    s = socket.create_connection((address, port), timeout=20)
    head = f"GET {path} HTTP/1.1\r\nHost: {address}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    head += "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
    s.sendall((head + (f"Origin: {origin}\r\n" if origin else "") + "\r\n").encode())
    answer = b""
    while b"\r\n\r\n" not in answer:
        got = s.recv(1)
        if not got:
            break
        answer += got
    return s, b" 101 " in answer


def say(s, **what):
    text = json.dumps(what).encode()
    s.sendall(bytes([0x81, 0x80 | len(text)]) + b"\0\0\0\0" + text)


def take(s, n):
    taken = b""
    while len(taken) < n:
        got = s.recv(n - len(taken))
        if not got:
            raise EOFError
        taken += got
    return taken


def read_texts(s, until):
    """Texts that come until then; pictures are passed over."""
    while time.monotonic() < until:
        s.settimeout(max(0.01, until - time.monotonic()))
        try:
            first, size = take(s, 2)
            if size >= 126:
                size = int.from_bytes(take(s, 2 if size == 126 else 8), "big")
            payload = take(s, size)
        except (socket.timeout, EOFError):
            return
        if first & 15 == 1:
            yield json.loads(payload)


def wait_for_url(file):
    until = time.monotonic() + 60
    while time.monotonic() < until:
        found = re.search(r"http://127\.0\.0\.1:(\d+)/\?token=(\w+)", open(file).read())
        if found:
            return int(found[1]), found[2]
        time.sleep(0.05)
    sys.exit("palpate has printed no address")


def main(address, output):
    port, token = wait_for_url(output)
    for path, origin in [("/frames", None), ("/frames?token=" + token[:-1], None), ("/frames?token=" + "0" * len(token), None),
                         (f"/frames?token={token}", "http://example.org"), (f"/frames?token={token}", "http://localhost:evil"),
                         (f"/frames?token={token}", f"http://{address}:{port}.example.org")]:
        s, accepted = open_socket(address, port, path, origin)
        if accepted:
            say(s, rearm=True)
            print("let in:", path, origin)
        s.close()
    s, accepted = open_socket(address, port, f"/frames?token={token}", f"http://{address}:{port}")
    print("a page with the token is let in" if accepted else "refused with the token")
    if not accepted:
        return
    for message in read_texts(s, time.monotonic() + 30):
        if message.get("faults"):
            print("fault:", message["faults"])
            break
    s.close()
    # A page that is opened only now hears of it, too.
    s, _ = open_socket(address, port, f"/frames?token={token}")
    for message in read_texts(s, time.monotonic() + 5):
        if message.get("faults"):
            print("told to newcomers:", message["faults"])
            break
    asked = time.monotonic()
    while time.monotonic() < asked + 4:
        say(s, rearm=True)
        for message in read_texts(s, time.monotonic() + 0.5):
            if message.get("error"):
                print("answer:", message["error"])
            if message.get("faults") == "":
                print("armed again")
                return


main(*sys.argv[1:])
