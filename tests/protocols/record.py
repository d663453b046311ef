"""Runs `umo live` and keeps what it sends: record.py VMC.hex LIVELINK.hex COMMAND…

`{vmc}` and `{livelink}` in the command's words become addresses that this program listens at. A line of a file is one
datagram.
"""

import selectors
import socket
import subprocess
import sys

BUFFER = 8 << 20


def listener() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
    made.bind(("127.0.0.1", 0))
    return made


def main(vmc: str, livelink: str, command: list[str]) -> int:
    sockets = {"vmc": listener(), "livelink": listener()}
    addresses = {name: f"127.0.0.1:{made.getsockname()[1]}" for name, made in sockets.items()}
    received: dict[str, list[bytes]] = {"vmc": [], "livelink": []}
    selector = selectors.DefaultSelector()
    for name, made in sockets.items():
        selector.register(made, selectors.EVENT_READ, name)
    sender = subprocess.Popen([word.format(**addresses) for word in command])
    while True:
        is_over = sender.poll() is not None
        ready = selector.select(0.2)
        for key, _ in ready:
            received[key.data].append(key.fileobj.recv(65536))
        if is_over and not ready:
            break
    for name, path in (("vmc", vmc), ("livelink", livelink)):
        with open(path, "w") as file:
            file.writelines(datagram.hex() + "\n" for datagram in received[name])
    return sender.returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2], sys.argv[3:]))
