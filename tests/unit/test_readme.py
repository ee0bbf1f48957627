"""The README's example of mapping a folder of scans does what it says, in under 20 lines."""

import re
from pathlib import Path

import numpy as np
import pytest

README = Path("README.md")


def test_a_folder_of_scans_becomes_maps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = re.search(r"```python\n(.*?)```", README.read_text(), re.S).group(1)
    assert len(code.splitlines()) < 20
    (tmp_path / "scans").mkdir()
    rng = np.random.default_rng(5)
    for i in range(3):
        xy = rng.uniform(480, 520, (5_000, 2))
        points = np.column_stack([xy, 0.1 * xy[:, 0]])
        np.savez(tmp_path / f"scans/{i:03d}.npz", points=points, ranges_m=np.full(len(xy), 20.0),
                 position_m=np.array([500.0, 500.0, 51.0]), stamp_ns=i * 400_000_000)  # fmt: skip
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    with np.load("glrm.npz") as glrm:
        known = glrm["confidence"] > 0
        assert known.sum() == 64
        _, cols = np.nonzero(known)
        assert np.allclose(glrm["height"][known], 0.1 * (cols + 0.5) * 5.0, atol=0.15)
        assert np.allclose(glrm["gradient_x"][known], 0.1, atol=0.02)
    with np.load("hrm.npz") as hrm:
        assert hrm["height"].shape == (320, 320)
