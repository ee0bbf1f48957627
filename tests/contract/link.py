"""A TCP link between two loopback ports that can be cut and healed, by resets or by silence."""

from __future__ import annotations

import selectors
import socket
import threading
import time

BLOCK = 65_536


class Link:
    """Forwards what comes to `endpoint` to a port; a context manager. Bounded by what its two sides send."""

    def __init__(self, target_port: int) -> None:
        self._target_port = target_port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"
        self._ends: dict[socket.socket, socket.socket] = {}
        self._is_whole, self._is_dropping, self._closed = True, False, False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Link:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed = True
        self._thread.join(5)
        self._drop_all()
        self._listener.close()

    def fall_silent(self) -> None:
        """Carry nothing any more and say nothing: a pulled cable."""
        self._is_whole = False

    def reset(self) -> None:
        """End every connection, and carry nothing any more."""
        self._is_whole, self._is_dropping = False, True

    def heal(self) -> None:
        """Carry again; what was open before the cut is lost, as it is with a cable pulled for longer than a lease."""
        self._is_whole, self._is_dropping = True, True

    def _drop_all(self) -> None:
        for end in self._ends:
            end.close()
        self._ends.clear()

    def _run(self) -> None:
        """The only thread that touches the sockets."""
        while not self._closed:
            if self._is_dropping:
                self._is_dropping = False
                self._drop_all()
            if not self._is_whole:
                time.sleep(0.02)
                continue
            with selectors.DefaultSelector() as selector:
                for end in (self._listener, *self._ends):
                    selector.register(end, selectors.EVENT_READ)
                for key, _ in selector.select(0.02):
                    self._serve(key.fileobj)  # type: ignore[arg-type]

    def _serve(self, end: socket.socket) -> None:
        if end is self._listener:
            self._accept()
        elif end in self._ends:
            self._carry(end)

    def _accept(self) -> None:
        near, _ = self._listener.accept()
        try:
            far = socket.create_connection(("127.0.0.1", self._target_port))
        except OSError:  # nobody there yet: the router comes again
            near.close()
            return
        self._ends |= {near: far, far: near}

    def _carry(self, end: socket.socket) -> None:
        other = self._ends[end]
        try:
            block = end.recv(BLOCK)
            if block:
                other.sendall(block)
                return
        except OSError:
            pass
        for gone in (end, other):
            self._ends.pop(gone)
            gone.close()
