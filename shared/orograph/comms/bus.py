"""One process's place on both planes: sessions, subscriptions, numbered sends, liveliness."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TypeVar

import zenoh

from orograph import keys
from orograph.comms import wire
from orograph.comms.callbacks import Callbacks
from orograph.comms.mailbox import Mailbox
from orograph.comms.session import client
from orograph.control import Control, Figures
from orograph.messages import Message

C = TypeVar("C", bound=Control)
CONTROL = zenoh.Priority.INTERACTIVE_HIGH


class Bus:
    """Sessions by plane. The sim plane blocks rather than drops, as a wire loses nothing; the radio may lose."""

    def __init__(self, sessions: dict[str, zenoh.Session]) -> None:
        self.sessions = sessions
        self.callbacks = Callbacks()
        self.sent: Counter[str] = Counter()
        """Messages of this frame by stream."""
        self.bytes_sent: Counter[tuple[str, str, str]] = Counter()
        self._index: Counter[str] = Counter()
        self._frame = -1

    @classmethod
    @contextmanager
    def open(cls, sim: str, radio: str | None, stop: threading.Event) -> Iterator[Bus]:
        """Connect to the planes' routers, waiting for them."""
        with ExitStack() as stack:
            sessions = {keys.SIM: stack.enter_context(client(sim, stop))}
            if radio is not None:
                sessions[keys.RADIO] = stack.enter_context(client(radio, stop))
            yield cls(sessions)

    def begin(self, frame: int) -> None:
        """Start counting a new frame's messages."""
        self._frame = frame
        self._index.clear()
        self.sent.clear()

    def send(self, sender: str, plane: str, to: str, message: Message) -> None:
        """Send one node's message, numbered within this frame."""
        assert any(route.carries(plane, sender, to) for route in message.routes), (sender, plane, to, message)
        key = keys.message_key(plane, to, type(message).__name__, sender)
        index = self._index[sender]
        self._index[sender] += 1
        for piece in wire.fragments(self._frame, index, wire.encode(message)):
            self.bytes_sent[plane, to, sender] += len(piece)
            self.sessions[plane].put(key, piece, congestion_control=_congestion(plane), express=True)
        self.sent[keys.stream_name(plane, to, sender)] += 1

    def listen(self, nodes: Iterable[str], mailbox: Mailbox) -> None:
        """Subscribe to these nodes' keys on every plane and be sure that the routers know it."""
        for plane, session in self.sessions.items():
            for key in sorted({k for name in nodes for k in keys.inbox_keys(plane, name)}):
                self._subscribe(session, key, lambda s: mailbox.add(str(s.key_expr), s.payload.to_bytes()))
            self._round_trip(session)

    def _round_trip(self, session: zenoh.Session) -> None:
        """A liveliness query travels behind the declarations: its answer means that the router holds them."""
        for _ in session.liveliness().get(keys.ALIVE_ALL, timeout=2.0):
            pass

    def hear(self, key: str, kind: type[C], callback: Callable[[C], None]) -> None:
        """Subscribe to one kind of control message on the sim plane; what is no such message is counted."""
        session = self.sessions[keys.SIM]
        self._subscribe(session, key, lambda s: callback(wire.decode(kind, s.payload.to_bytes())))

    def _subscribe(self, session: zenoh.Session, key: str, callback: Callable[[zenoh.Sample], None]) -> None:
        # The subscriber lives as long as the session: dropping the handle of a callback subscriber keeps it.
        session.declare_subscriber(key, self.callbacks.guarded(keys.callback_kind(key), callback))

    def tell(self, key: str, message: Control) -> None:
        """Send a control message on the sim plane, ahead of data."""
        block = zenoh.CongestionControl.BLOCK
        payload = wire.encode(message)
        self.sessions[keys.SIM].put(key, payload, congestion_control=block, priority=CONTROL, express=True)

    def show(self, node_name: str, figures: Figures) -> None:
        """Send figures for people; they may be dropped."""
        self.sessions[keys.SIM].put(keys.telemetry_key(node_name), wire.encode(figures))

    def token(self, service: str, instance: str, robots: tuple[str, ...]) -> zenoh.LivelinessToken:
        """Say that this instance lives and which robots it holds, until the token is undeclared or the process dies."""
        return self.sessions[keys.SIM].liveliness().declare_token(keys.alive_key(service, instance, robots))

    def watch_alive(self, callback: Callable[[str, str, tuple[str, ...], bool], None]) -> None:
        """Call back (service, instance, robots, alive) for every token there is and every change."""

        def on_token(sample: zenoh.Sample) -> None:
            service, instance, robots = keys.parse_alive_key(str(sample.key_expr))
            callback(service, instance, robots, sample.kind == zenoh.SampleKind.PUT)

        guarded = self.callbacks.guarded(keys.callback_kind(keys.ALIVE_ALL), on_token)
        self.sessions[keys.SIM].liveliness().declare_subscriber(keys.ALIVE_ALL, guarded, history=True)

    def ask(
        self, key: str, question: Control | None, kind: type[C], timeout_s: float, plane: str = keys.SIM
    ) -> C | None:
        """The first answer that is one, None where nobody gives any; what is none is counted."""
        payload = b"" if question is None else wire.encode(question)
        answers: list[C] = []
        take = self.callbacks.guarded(keys.callback_kind(key), lambda ok: answers.append(wire.decode(kind, ok)))
        congestion = _congestion(plane)
        for reply in self.sessions[plane].get(key, payload=payload, timeout=timeout_s, congestion_control=congestion):
            if reply.ok is not None:
                take(reply.ok.payload.to_bytes())
            if answers:
                return answers[0]
        return None

    def answer(self, key: str, reply: Callable[[], Control], plane: str = keys.SIM) -> None:
        """Answer queries that ask nothing in particular; a radio that has no room loses the answer."""
        self._answer(plane, key, lambda _: reply())

    def answer_each(self, key: str, kind: type[C], reply: Callable[[C], Control], plane: str = keys.SIM) -> None:
        """Answer queries of one kind; what is no such query is counted and gets no answer."""
        self._answer(plane, key, lambda payload: reply(wire.decode(kind, payload)))

    def _answer(self, plane: str, key: str, reply: Callable[[bytes], Control]) -> None:
        def on_query(query: zenoh.Query) -> None:
            with query:
                query.reply(key, wire.encode(reply(query.payload.to_bytes() if query.payload else b"")))

        self.sessions[plane].declare_queryable(key, self.callbacks.guarded(keys.callback_kind(key), on_query))


def _congestion(plane: str) -> zenoh.CongestionControl:
    return zenoh.CongestionControl.DROP if plane == keys.RADIO else zenoh.CongestionControl.BLOCK
