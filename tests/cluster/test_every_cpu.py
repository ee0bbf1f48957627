"""One map on every CPU: missions told to leave out what this machine has and others have not."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from orograph.storage.results import Summary

pytestmark = pytest.mark.cluster

RUN = """
import sys
from pathlib import Path
from orograph.launch.lifecycle import run
from orograph.storage.scenario_file import load_scenario
run(load_scenario("scenarios/tiny"), Path(sys.argv[1]), in_process=True)
"""


@pytest.mark.parametrize(
    "without",
    [
        {"NUMBA_CPU_NAME": "skylake", "NPY_DISABLE_CPU_FEATURES": "X86_V4", "OPENBLAS_CORETYPE": "Haswell"},
        {"NUMBA_CPU_NAME": "generic", "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4", "OPENBLAS_CORETYPE": "Prescott"},
    ],
    ids=["no AVX-512", "no vectors beyond SSE4.2"],
)
def test_a_cpu_with_less_gives_the_same_map(in_process: Summary, tmp_path: Path, without: dict[str, str]) -> None:
    """The C library's sines stay: they differ without FMA, which every CPU with AVX2 has."""
    command = [sys.executable, "-W", "ignore", "-c", RUN, str(tmp_path / "run")]
    subprocess.run(command, check=True, env=os.environ | without)
    assert Summary.read(tmp_path / "run").glrm_hash == in_process.glrm_hash
