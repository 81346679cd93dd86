"""Sniffer on a machine between others: writes every frame on its links to a file until ended.

Prints `listening` when ready: a test that waits for it misses nothing.
"""

import socket
import sys
from pathlib import Path

_ETH_P_ALL = 3


def main(file: Path) -> None:
    link = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_ETH_P_ALL))
    link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 24)
    with link, file.open("wb", buffering=0) as out:
        print("listening", flush=True)
        while True:
            out.write(link.recv(1 << 16))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
