"""What commands that ask a running cluster need."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import pytest
from ports import free_port


@pytest.fixture(scope="module")
def router() -> Iterator[str]:
    """A real router, by its endpoint."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    process = subprocess.Popen([sys.executable, "-m", "services.router", "--listen", endpoint])
    try:
        yield endpoint
    finally:
        process.kill()
        process.wait()
