"""The traces of a run for Wireshark: one timeline that tshark reads with our dissectors."""

import json
import re
import shlex
import subprocess
from collections import Counter
from decimal import Decimal
from pathlib import Path
from tempfile import TemporaryFile

import pytest
from conftest import ROOT, TSHARK, in_runs, qmn, typed, verb, wait_until
from limits import SOON_S
from loaded import read, running_qmn

from views.dissection.dissectors import search_path


def tshark(run: Path, *options: str) -> list[str]:
    script = ["-X", f"lua_script:{run / 'qmn.lua'}"]
    command = [*TSHARK, "-2", *script, "-r", str(run / "all.pcapng"), *options]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=SOON_S)
    assert "Lua" not in done.stderr + done.stdout
    return done.stdout.splitlines()


def fields(run: Path, expression: str, *names: str) -> list[tuple[str, ...]]:
    options = ["-Y", expression, "-T", "fields"]
    for name in names:
        options += ["-e", name]
    return [tuple(line.split("\t")) for line in tshark(run, *options)]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run."""
    runs = tmp_path_factory.mktemp("runs")
    # Slow enough that the controller asks the switch for the light of its ports meanwhile.
    light = ("--rate-hz", "250", "--block-pairs", "400")
    slow = ("--message", "see " * 20, *light)
    done = qmn(*slow, "--depolarizing", "0.003", "--frame-bytes", "8", runs=runs)
    assert done.returncode == 0, done.stdout + done.stderr
    return runs / "latest"


def capinfos(file: Path) -> str:
    command = ["capinfos", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=SOON_S)
    assert done.stderr.replace("\n", "").startswith("Running as user") or done.stderr == ""
    return done.stdout


def test_capinfos_finds_named_interfaces_and_nothing_wrong(run: Path) -> None:
    fibers = ("fiber alice-q0", "fiber charlie-q1", "dispatcher")
    merged, quantum = capinfos(run / "all.pcapng"), capinfos(run / "quantum.pcapng")
    for name in fibers:
        assert f"Name = {name}\n" in merged
        assert f"Name = {name}\n" in quantum
    for name in ("s1-eth1", "c0"):
        assert f"Name = {name}\n" in merged
    assert "Strict time order:   True" in merged


def times(file: Path) -> dict[str, list[tuple[str, str]]]:
    """Return time and digest of each packet by its interface: of a capture, "" is the only one."""
    digest = ["-o", "frame.generate_md5_hash:TRUE", "-T", "fields"]
    shown = ["-e", "frame.interface_name", "-e", "frame.time_epoch", "-e", "frame.md5_hash"]
    command = [*TSHARK, "-r", str(file), *digest, *shown]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=SOON_S)
    found: dict[str, list[tuple[str, str]]] = {}
    for line in done.stdout.splitlines():
        name, time_s, digest_ = line.split("\t")
        found.setdefault(name, []).append((time_s, digest_))
    return found


def test_captures_have_the_times_of_the_timeline_and_keep_them(run: Path) -> None:
    """The clock of the network led the wall by 1,000 s when the run ended."""
    timeline, captures = run / "all.pcapng", sorted(run.glob("*.pcap"))
    merged, before = times(timeline), {file: file.read_bytes() for file in [timeline, *captures]}
    assert len(captures) > 4
    for file in captures:
        assert times(file)[""] == merged[file.stem]
        assert Decimal(merged[file.stem][-1][0]) > file.stat().st_mtime + 900
    assert verb("wireshark", str(run), "--whole").stdout
    assert {file: file.read_bytes() for file in before} == before


@pytest.mark.image
def test_wireshark_sees_packets_and_qubits_on_one_timeline(run: Path) -> None:
    # alice hangs on s1-eth1, bob on s1-eth2: pending before the controller, granted behind it.
    seen = fields(
        run, 'qmeta.service == "SDC"', "frame.interface_name", "qmeta.verdict", "qmeta.response_in"
    )
    assert [row[:2] for row in seen] == [("s1-eth1", "0"), ("s1-eth2", "1")]
    assert all(row[2] for row in seen)
    kinds = Counter(row[0] for row in fields(run, "qevent", "qevent.kind"))
    assert kinds.keys() >= {"open", "create", "send", "arrive", "receive", "apply", "bell-measure"}
    log = (run / "quantum.log").read_text().splitlines()
    assert kinds.total() == len(log)
    assert fields(run, "qof", "frame.interface_name").count(("c0",)) > 0
    assert fields(run, 'qdev.kind == "DeviceReport" && qdev.request_in', "qdev.host")
    bad = "qmeta.malformed || qdev.malformed || qevent.malformed || qof.malformed"
    assert tshark(run, "-Y", bad) == []

    # One clock: the light path opens before the controller lets the set-up message go on, and
    # light is measured before bob reports it.
    times = {
        what: Decimal(fields(run, expression, "frame.time_epoch")[0][0])
        for what, expression in {
            "open": 'qevent.kind == "open"',
            "granted": 'qmeta.verdict == "GRANTED"',
            "measured": 'qevent.kind == "bell-measure"',
            "reported": 'qmeta.kind == "Report"',
        }.items()
    }
    assert times["open"] < times["granted"] < times["measured"] < times["reported"]


def test_the_filters_of_the_documentation_find_something(run: Path) -> None:
    text = (ROOT / "docs" / "timeline.md").read_text()
    commands = [line for line in text.splitlines() if line.startswith("tshark ")]
    assert len(commands) == 4
    for command in commands:
        words = shlex.split(command.replace("$PWD", str(run)))
        done = subprocess.run(words, cwd=run, capture_output=True, text=True, check=True)
        assert done.stdout, command
        assert "Lua" not in done.stderr
    (session,) = re.findall(r"qevent.session == 0x(\w+)", text)
    spied = verb("spy", str(run), "--session", session, "--kind", "bell-measure")
    assert re.search(rf"session={session} block=1/0 photons=\d+ with 1/1: Phi\+=\d+", spied.stdout)
    assert "noise: " in verb("spy", str(run), "--kind", "arrive").stdout


def test_the_scapy_lines_of_the_documentation_show_what_was_sent(run: Path) -> None:
    text = typed("timeline.md", 0, run)
    assert 'kind: "open"' in text
    assert "[1]" in text  # granted
    assert "quantum device datagram" in text


def test_a_spy_sees_every_event_of_a_network_and_ends_with_it(tmp_path: Path) -> None:
    with (
        TemporaryFile("w+") as errors,
        running_qmn("cli", "sdc", "--runs", str(tmp_path), typed=True, end_s=60) as network,
    ):
        assert network.stdin is not None
        wait_until(lambda: in_runs("*/network.json"), "a network")
        with running_qmn("spy", "--history", "--json", errors=errors) as process:
            network.stdin.write("alice qsend bob spied\n")
            first = process.stdout.readline()  # somebody watches
            network.stdin.write("exit\n")
            network.finish(60)
            lines = first + process.finish(30)
        text = read(errors)
    assert process.returncode == 0, text
    seen = [json.loads(line) for line in lines.splitlines()]
    log = (tmp_path / "latest" / "quantum.log").read_text().splitlines()
    assert [event["time"] for event in seen] == [line.split()[0] for line in log]
    assert text == f"qmn: {len(log)} events shown, 0 dropped\n"


@pytest.mark.image
def test_what_a_host_asks_of_the_dispatcher_is_read_as_grpc(run: Path) -> None:
    lines = tshark(run, *search_path(run), "-Y", "ip.src == 10.0.0.1 && grpc", "-V")
    text = "\n".join(lines)
    assert "GRPC Message: /qmn.Dispatcher/Perform, Request" in text
    assert re.search(r"port = alice-q0 \(string\)", text)
