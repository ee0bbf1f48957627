"""What a kept result was made by: a digest of the code, so that a changed algorithm never finds an old result."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path


@cache
def code_digest(module: str) -> str:
    """Digest (32 hex digits) of a module's source and of every module of its package that it imports, however deep."""
    digest = hashlib.blake2b(digest_size=16)
    for name, source in sorted(_sources(module).items()):
        digest.update(name.encode() + b"\0" + source + b"\0")
    return digest.hexdigest()


def _sources(module: str) -> dict[str, bytes]:
    package = module.split(".")[0]
    spec = find_spec(package)
    assert spec is not None and spec.origin is not None, f"{package} has no source"
    home = Path(spec.origin).parents[1]
    found: dict[str, bytes] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = None if name in found else _path(home, name)
        if path is not None:
            found[name] = path.read_bytes()
            waiting += [f for f in _imported(found[name]) if f.split(".")[0] == package]
    assert module in found, f"{module} has no source"
    return found


def _path(home: Path, name: str) -> Path | None:
    """A module's file; None where the name is that of something inside a module."""
    base = home.joinpath(*name.split("."))
    return next((path for path in (base.with_suffix(".py"), base / "__init__.py") if path.exists()), None)


def _imported(source: bytes) -> Iterator[str]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            assert node.level == 0, "imports are absolute"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
