"""docs/messages.md and messages.json, the schema of summaries, and the README's picture are what the code says."""

import re
import runpy
from pathlib import Path

from orograph import keys
from orograph.messages import KINDS
from orograph.storage.results import Summary

README = Path("README.md")


def test_the_reference_of_messages_is_current() -> None:
    written = runpy.run_path("ops/reference.py")
    for name, content in (("messages.md", written["reference"]()), ("messages.json", written["contracts"]())):
        assert (Path("docs") / name).read_text() == content, "run: .venv/bin/python ops/reference.py"


def test_the_schema_of_summaries_is_current() -> None:
    schema = runpy.run_path("ops/reference.py")["pretty"](Summary.model_json_schema())
    assert Path("docs/summary.schema.json").read_text() == schema, "run: .venv/bin/python ops/reference.py"


def test_the_pictures_edges_are_the_routes() -> None:
    picture = re.search(r"```mermaid\n(.*?)```", README.read_text(), re.S)[1]
    edge = re.compile(r"(\S+) (-[-.]) (.+) (-->|\.->) (\S+)")
    drawn = {
        (keys.SIM if line[2] == "--" else keys.RADIO, line[1], line[5], kind)
        for line in map(edge.fullmatch, map(str.strip, picture.splitlines()[1:]))
        for kind in line[3].split(", ")
    }
    routed = {
        (route.plane, route.sender, keys.split(route.to)[0], name)
        for name, cls in KINDS.items()
        for route in cls.routes
    }
    assert drawn == routed
