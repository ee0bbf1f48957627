"""A person's way to a running cluster: the radio plane's router, reached from outside."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event

from orograph import keys
from orograph.comms.bus import Bus
from orograph.comms.session import client
from orograph.errors import InputError, RunError

ROUTER = "tcp/127.0.0.1:17448"
"""Where ops/status.compose.yaml publishes the radio plane's router."""
ANSWER_S = 2.0


def add_option(parser: argparse.ArgumentParser) -> None:
    """Declare `--router`."""
    parser.add_argument(
        "--router", default=ROUTER, metavar="ENDPOINT",
        help="the radio plane's router: tcp/HOST:PORT (default: %(default)s)",
    )  # fmt: skip


def check_endpoint(text: str) -> None:
    """Raise InputError for what is no endpoint."""
    protocol, _, address = text.partition("/")
    host, _, port = address.rpartition(":")
    if protocol != "tcp" or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise InputError(f"--router {text}: expected tcp/HOST:PORT, as {ROUTER}")


@contextmanager
def router(endpoint: str) -> Iterator[Bus]:
    """The radio plane through a router; raises InputError for what is no endpoint, RunError where none answers."""
    check_endpoint(endpoint)
    once = Event()
    once.set()
    try:
        with client(endpoint, once) as session:
            yield Bus({keys.RADIO: session})
    except InterruptedError:
        raise RunError(f"no router answers at {endpoint}: is the cluster up, and its radio port published?") from None
