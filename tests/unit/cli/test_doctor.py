"""The doctor names what is missing and the command that mends it, also where the patient cannot be imported."""

from __future__ import annotations

import argparse
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from orograph.cli import doctor
from orograph.cli.doctor import Check


def test_this_machine_is_well_and_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    checks = doctor.run_checks()
    assert [c for c in checks if not c.ok] == []
    doctor.print_report(checks)
    printed = capsys.readouterr().out
    assert all(c.name in printed for c in checks) and "missing" not in printed
    doctor.print_report(checks, quiet=True)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("check", "cure"),
    [
        (doctor.check_python((3, 10, 9)), "python3.11"),
        (doctor.check_python((3, 14, 0)), "python3.11"),
        (doctor.check_library("libOrographNone.so.9", "libnone"), "apt-get install libnone"),
        (doctor.check_module("orograph_none", "world"), "make setup"),
        (doctor.check_ports("203.0.113.7"), "ip link set lo up"),
        (doctor.check_memory(lambda: 1024**3), "ps aux"),
        (doctor.check_writable("cache", Path("/proc/orograph"), "export NUMBA_CACHE_DIR"), "NUMBA_CACHE_DIR"),
    ],
)
def test_what_is_missing_is_named_with_its_cure(check: Check, cure: str) -> None:
    assert not check.ok and check.found and cure in check.cure


def test_a_module_that_breaks_on_import_is_missing_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "orograph_broken.py").write_text("raise RuntimeError('libGL.so.1: no such file\\nand more')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    check = doctor.check_module("orograph_broken", "world")
    assert not check.ok and check.found == "RuntimeError: libGL.so.1: no such file"
    assert "orograph[world]" in check.cure


def test_ports_are_given_back() -> None:
    check = doctor.check_ports()
    assert check.ok
    for port in check.found.split(", "):
        with socket.socket() as again:
            again.bind(("127.0.0.1", int(port)))


def test_every_dependency_is_looked_at() -> None:
    import tomllib

    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
    wheels = {"eclipse-zenoh": "zenoh", "pyyaml": "yaml", "prometheus-client": "prometheus_client",
              "kiss-icp": "kiss_icp"}  # fmt: skip
    extras = {"": project["dependencies"], **project["optional-dependencies"]}
    for extra, names in doctor.MODULES.items():
        wanted = {wheels.get(bare, bare) for bare in (n.split(">")[0].split("[")[0] for n in extras[extra])}
        assert {m.split(".")[0] for m in names} == wanted, extra


def test_one_missing_thing_is_exit_code_1(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    ill = [Check("import dartpy", False, "ImportError: libGL.so.1", "sudo apt-get install libgl1")]
    monkeypatch.setattr(doctor, "run_checks", lambda: ill)
    assert doctor.main(argparse.Namespace(quiet=True)) == 1
    printed = capsys.readouterr().out
    assert "missing" in printed and "sudo apt-get install libgl1" in printed


def test_it_works_without_dartpy_and_without_rich() -> None:
    program = (
        "import sys; sys.modules['dartpy'] = None; sys.modules['rich'] = None; sys.modules['rich.console'] = None\n"
        "import argparse; from orograph.cli import doctor\n"
        "sys.exit(doctor.main(argparse.Namespace(quiet=True)))\n"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.returncode == 1, run.stderr
    assert "missing  import dartpy" in run.stdout and "missing  import rich" in run.stdout


def test_the_command_line_knows_it() -> None:
    top = argparse.ArgumentParser()
    doctor.add_parser(top.add_subparsers())
    args = top.parse_args(["doctor", "--quiet"])
    assert args.main is doctor.main and args.quiet
