"""Tap on a TCP link to a Zenoh router: keeps what each client sends, as it came."""

import socket
import threading
from typing import Self


class Tap:
    """Loopback port in front of another one, for any number of clients."""

    def __init__(self, port: int, host: str = "127.0.0.1") -> None:
        self._to = host, port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.place = f"127.0.0.1:{self._listener.getsockname()[1]}"
        self.sent: list[list[bytes]] = []
        """Pieces that each client has sent so far."""

    def __enter__(self) -> Self:
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            router = socket.create_connection(self._to)
            self.sent.append([])
            for ends in ((client, router, self.sent[-1]), (router, client, [])):
                threading.Thread(target=_pump, args=ends, daemon=True).start()


def _pump(source: socket.socket, sink: socket.socket, kept: list[bytes]) -> None:
    with source, sink:
        try:
            while data := source.recv(65_536):
                kept.append(data)
                sink.sendall(data)
        except OSError:
            pass
