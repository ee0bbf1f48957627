"""Bad input: one clear line, exit code 2, nothing half written, no traceback."""

import socket
from pathlib import Path

import pytest
from orograph.cli.main import main


def _error(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    assert main(argv) == 2
    out, err = capsys.readouterr()
    assert not out and err.startswith("orograph: ") and "Traceback" not in err
    return err


def test_unknown_scenario(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert "atlantis" in _error(capsys, "run", "atlantis", "--out", str(tmp_path / "run"))
    assert not (tmp_path / "run").exists()


def test_a_file_that_is_no_scenario(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    bad = tmp_path / "scenario.yaml"
    bad.write_text("name: x\nrobots: many\n")
    message = _error(capsys, "run", str(bad), "--out", str(tmp_path / "run"))
    assert "robots" in message and "patrol" in message


@pytest.mark.parametrize("robots", ["0", "11", "-1"])
def test_a_robot_count_beyond_the_scenarios(capsys: pytest.CaptureFixture[str], tmp_path: Path, robots: str) -> None:
    message = _error(capsys, "run", "scenarios/tiny", "--robots", robots, "--out", str(tmp_path / "run"))
    assert "1 to 10 robots" in message


@pytest.mark.parametrize("scale", ["fast", "0", "-2", "nan"])
def test_a_time_scale_that_is_none(capsys: pytest.CaptureFixture[str], tmp_path: Path, scale: str) -> None:
    _error(capsys, "run", "scenarios/tiny", f"--time-scale={scale}", "--out", str(tmp_path / "run"))
    assert not (tmp_path / "run").exists()


def test_a_folder_with_something_in_it_is_left_alone(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "precious.txt").write_text("mine")
    assert "not an empty folder" in _error(capsys, "run", "scenarios/tiny", "--out", str(tmp_path))
    assert [p.name for p in tmp_path.iterdir()] == ["precious.txt"]


def test_a_folder_that_cannot_be_written(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert "cannot be written" in _error(capsys, "run", "scenarios/tiny", "--out", str(tmp_path / "file" / "run"))


def test_a_capacity_below_one(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert "--capacity -1: expected 1 or more" in _error(
        capsys, "run", "scenarios/tiny", "--capacity", "-1", "--out", str(tmp_path / "run")
    )


def test_a_port_that_is_taken(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        message = _error(
            capsys, "run", "scenarios/tiny", "--quiet", "--sim-port", str(port), "--out", str(tmp_path / "run")
        )
    assert f"port {port}" in message


@pytest.mark.parametrize("command", [["run", "scenarios/tiny", "--view"], ["view", "no-run", "--port"]])
def test_a_page_whose_port_is_taken(capsys: pytest.CaptureFixture[str], tmp_path: Path, command: list[str]) -> None:
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        port = str(holder.getsockname()[1])
        assert f"port {port} on 127.0.0.1" in _error(capsys, *command, port)


def test_a_page_of_a_run_in_one_process(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--in-process" in _error(capsys, "run", "scenarios/tiny", "--in-process", "--view")
