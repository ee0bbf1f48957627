"""docs/messages.md is what the code says."""

import runpy
from pathlib import Path


def test_the_reference_of_messages_is_current() -> None:
    written = runpy.run_path("ops/reference.py")
    assert Path("docs/messages.md").read_text() == written["reference"](), "run: .venv/bin/python ops/reference.py"
