"""qmn wireshark where there is a Wireshark, and where there is none."""

import argparse
import re
import shlex
import subprocess
from pathlib import Path

import pytest

from dispatcher.layer.history import EventCapture
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.verbs import wireshark
from wire.dispatcher_pb2 import Event

EVENT = Event(time_ns=1_700_000_000_000_000_000, node="alice", kind="create")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Write dissectors here, not into the home of who tests."""
    monkeypatch.setenv("QMN_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Return the folder of a run that was ended before it merged anything."""
    folder = tmp_path / "a run"
    folder.mkdir()
    with (folder / EVENT_CAPTURE).open("wb") as opened:
        EventCapture(opened, []).record(EVENT)
    return folder


def verb(run: Path) -> int:
    parser = argparse.ArgumentParser()
    wireshark.add_parser(parser.add_subparsers())
    arguments = parser.parse_args(["wireshark", str(run)])
    status: int = arguments.call(arguments)
    return status


def test_without_a_display_it_prints_what_to_type(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert verb(run) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    (graphical,) = [line for line in lines if line.startswith("wireshark ")]
    (typed,) = [line for line in lines if line.startswith("tshark ")]
    done = subprocess.run(shlex.split(typed), capture_output=True, text=True, check=True)
    assert "alice create" in done.stdout
    # tshark takes the same options as Wireshark does: the columns, too.
    options = ["tshark", *shlex.split(graphical)[1:]]
    shown = subprocess.run(options, capture_output=True, text=True, check=True).stdout
    assert shown.split()[2:4] == ["dispatcher", "alice"]


def test_where_it_can_wireshark_is_started(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "wireshark"
    program.write_text(f'#!/bin/sh\nprintf "%s\\n" "$@" >"{tmp_path}/answer"\nexit 3\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    monkeypatch.setenv("DISPLAY", ":0")
    assert verb(run) == 3
    lines = (tmp_path / "answer").read_text().splitlines()
    assert lines[:2] == ["-X", f"lua_script:{tmp_path / 'cache' / 'qmn.lua'}"]
    assert lines[-4:-1] == ["-r", str(run / "all.pcapng"), "-Y"]  # and shows packets once
    assert "tcp.analysis.retransmission" in lines[-1]


def test_no_code_from_the_folder_of_a_run_is_loaded(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    ran = tmp_path / "ran"
    for name in ("qmn.lua", "init.lua", "grpc.lua"):
        (run / name).write_text(f'io.open("{ran}", "w"):close()\n')
    assert verb(run) == 0
    for command in re.findall("(?:wire|t)shark -.*", capsys.readouterr().out):
        words = ["tshark", *shlex.split(command)[1:]]
        done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=run)
        assert "alice" in done.stdout
    assert not ran.exists()


def test_a_link_in_the_folder_of_a_run_is_not_written_through(run: Path, tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.write_text("precious")
    for name in ("all.pcapng", ".all.pcapng", "qmn.lua", ".qmn.lua"):
        (run / name).symlink_to(precious)
    wireshark.prepare(run, whole=True)
    assert precious.read_text() == "precious"
    assert not (run / "all.pcapng").is_symlink()


def test_a_folder_without_captures_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert verb(tmp_path) == 1
    assert "name the folder of a run" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        verb(tmp_path / "none")
    assert f"there is no run '{tmp_path / 'none'}'" in capsys.readouterr().err
