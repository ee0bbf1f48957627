"""docs/messages.md and docs/summary.schema.json are what the code says."""

import runpy
from pathlib import Path

from orograph.storage.results import Summary


def test_the_reference_of_messages_is_current() -> None:
    written = runpy.run_path("ops/reference.py")
    assert Path("docs/messages.md").read_text() == written["reference"](), "run: .venv/bin/python ops/reference.py"


def test_the_schema_of_summaries_is_current() -> None:
    schema = runpy.run_path("ops/reference.py")["pretty"](Summary.model_json_schema())
    assert Path("docs/summary.schema.json").read_text() == schema, "run: .venv/bin/python ops/reference.py"
