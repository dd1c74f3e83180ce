"""The command line: what words mean, without a network."""

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from mininet.net import Mininet

from qmn.interactive import network_cli
from qmn.interactive.quantum_cli import QuantumCLI
from qmn.jobs.transfer import TransferError
from qmn.scripting.exchange import Exchange
from qmn.scripting.network import QuantumNetwork
from topologies.system.processes.programs import NetworkError


class Unstarted(QuantumNetwork):
    """A network with names alone, which notes what it is asked for."""

    def __init__(self) -> None:
        Mininet.inited = True  # it would change the machine
        self.net = Mininet(build=False)
        for name in ("alice", "bob"):
            host = SimpleNamespace(name=name, waiting=False)
            self.net.hosts.append(host)
            self.net.nameToNode[name] = host
        self.asked: list[tuple[Any, ...]] = []
        self.dead = ""

    def send(self, sender: str, receiver: str, data: bytes, **options: Any) -> Exchange:
        self.asked.append((sender, receiver, data))
        if data == b"fail" or len([each for each in self.asked if each[2] != data]) == 2:
            raise TransferError("alice to bob: light is taken")
        return Exchange(data, len(data), 0.004, 0.5, 200, 50, 150, 3, 0)

    def check(self) -> None:
        if self.dead:
            raise NetworkError(self.dead)


@pytest.fixture
def network() -> Unstarted:
    return Unstarted()


def test_a_quantum_verb_may_stand_behind_the_host(network: Unstarted) -> None:
    script = ["alice qsend bob hello,  there", "qsend bob alice hi"]
    assert QuantumCLI(network, script).failures == 0
    assert network.asked == [("alice", "bob", b"hello,  there"), ("bob", "alice", b"hi")]


def test_what_was_received_and_what_it_took_is_printed(
    network: Unstarted, capsys: pytest.CaptureFixture[str]
) -> None:
    QuantumCLI(network, ["qsend alice bob hello"])
    assert capsys.readouterr().out == (
        "bob: hello\n5 bytes, 200 pairs, 50 lost, 3 wrong; set-up 4.00 ms, then 500.00 ms\n"
    )


def test_qping_ends_with_statistics_also_where_a_round_fails(
    network: Unstarted, capsys: pytest.CaptureFixture[str]
) -> None:
    cli = QuantumCLI(network, ["alice qping bob 9"])  # the third round is refused
    assert cli.failures == 1
    shown = capsys.readouterr()
    assert "bob: round=2 200 pairs" in shown.out
    assert "3 rounds, 2 delivered; 400 pairs, 300 arrived, 25 % lost, 2 % wrong" in shown.out
    assert "set-up min/avg/max/mdev = 4.000/4.000/4.000/0.000 ms" in shown.out
    assert shown.err == "*** alice to bob: light is taken\n"


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("qsend alice bob", "usage: qsend SENDER RECEIVER TEXT"),
        ("alice qsend", "usage: qsend SENDER RECEIVER TEXT"),
        ("qping alice", "usage: qping SENDER RECEIVER [ROUNDS]"),
        ("qping alice bob 3 4", "usage: qping"),
        ("qping alice bob many", "rounds 'many' is not a number: choose 1 to 10000"),
        ("alice qiperf bob 0", "seconds 0: choose 0.1 to 3600"),
        ("qiperf alice bob nan", "seconds nan: choose"),
        ("qstate", "usage: qstate HOST"),
        ("qtrace alice", "usage: qtrace SENDER RECEIVER"),
        ("qlinks alice", "usage: qlinks"),
        ("qpaths now", "usage: qpaths"),
        ("qsend alice bob fail", "light is taken"),
        ("teleport alice bob", "*** Unknown command: teleport alice bob"),
        ("qpings alice bob", "*** Unknown command: qpings alice bob: did you mean qping?"),
        ("alise qping bob", "*** Unknown command: alise qping bob: did you mean alice?"),
        ("link alice", "invalid number of args: link"),
        ("source /nowhere", "*** source /nowhere: No such file or directory"),
        ("source", "usage: source FILE"),
        ("x nobody", "*** x nobody: KeyError: 'nobody'"),
        ("noecho", "*** noecho: ValueError: not enough values to unpack (expected 3, got 2)"),
        ("switch q9 start", "*** switch: 'q9': there are none"),
    ],
)
def test_a_command_that_fails_is_one_line_and_counts(
    network: Unstarted, capsys: pytest.CaptureFixture[str], line: str, text: str
) -> None:
    assert QuantumCLI(network, [line, "# a comment", ""]).failures == 1
    shown = capsys.readouterr()
    assert text in shown.err
    assert shown.err.count("\n") == 1


def test_a_script_goes_on_after_a_failure_and_ends_at_exit(network: Unstarted) -> None:
    script = ["qsend alice bob fail", "qsend alice bob on", "exit", "qsend alice bob never"]
    assert QuantumCLI(network, script).failures == 1
    assert [each[2] for each in network.asked] == [b"fail", b"on"]


def test_a_program_that_has_died_is_told_once(
    network: Unstarted, capsys: pytest.CaptureFixture[str]
) -> None:
    network.dead = "dispatcher died in mid-run"
    assert QuantumCLI(network, ["nodes", "nodes"]).failures == 1
    assert capsys.readouterr().err == "*** dispatcher died in mid-run\n"


def test_a_sourced_file_goes_on_after_a_failure(network: Unstarted, tmp_path: Path) -> None:
    (tmp_path / "lines").write_bytes(b"x \351\nqsend alice bob hi\n")
    assert QuantumCLI(network, [f"source {tmp_path / 'lines'}"]).failures == 1
    assert [each[2] for each in network.asked] == [b"hi"]


def test_a_wait_for_the_background_has_a_deadline(
    network: Unstarted, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(network_cli, "BACKGROUND_TIMEOUT_S", 0.1)
    cli = QuantumCLI(network, [])
    text, terminal = os.pipe()
    with os.fdopen(text) as stdout, open(os.devnull) as cli.stdin:
        monkeypatch.setattr(cli, "isatty", lambda: False)
        host = SimpleNamespace(
            name="bob", lastCmd="wait", stdout=stdout, waiting=True, shell_ended=False
        )
        host.write = lambda _keys: None
        host.sendInt = lambda: setattr(host, "waiting", False)
        cli.waitForNode(host)
    os.close(terminal)
    assert capsys.readouterr().err == "*** bob: 0.1 s are over\n"


@pytest.mark.parametrize("name", ["net", "qping", "sh", "net-1"])
def test_a_host_named_like_a_verb_is_a_host(
    network: Unstarted, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    network.net.hosts.append(SimpleNamespace(name=name, waiting=False))
    network.net.nameToNode[name] = network.net.hosts[-1]
    commands: list[str] = []
    monkeypatch.setattr(QuantumCLI, "default", lambda _cli, line: commands.append(line))
    assert QuantumCLI(network, [f"{name} echo hello"]).failures == 0
    assert commands == [f"{name} echo hello"]


def test_py_sees_what_scripts_see(network: Unstarted, capsys: pytest.CaptureFixture[str]) -> None:
    script = ["px sent = network.send('alice', 'bob', b'hi')", "py sent.bell_pairs"]
    QuantumCLI(network, [*script, "py alice.name"])
    assert capsys.readouterr().out == "200\nalice\n"


@pytest.mark.parametrize(
    ("text", "line", "completed"),
    [
        ("ql", "ql", ["qlinks"]),
        ("al", "al", ["alice"]),
        ("", "qping ", ["alice", "bob"]),
        ("b", "qping alice b", ["bob"]),
        ("qp", "alice qp", ["qpaths", "qping"]),
        ("", "link alice bob ", ["down", "up"]),
    ],
)
def test_verbs_and_hosts_are_completed(
    network: Unstarted, text: str, line: str, completed: list[str]
) -> None:
    cli = QuantumCLI(network, [])
    begin = len(line) - len(text)
    complete = cli.completenames if not begin else cli.completedefault
    assert complete(text, line, begin, len(line)) == completed


@pytest.mark.parametrize("verb", QuantumCLI.host_verbs)
def test_help_says_how_each_verb_is_used(
    network: Unstarted, capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    QuantumCLI(network, [f"help {verb}"])
    assert f"Usage: {verb}" in capsys.readouterr().out


def test_seven_quantum_verbs_are_known() -> None:
    assert QuantumCLI.host_verbs == [
        "qiperf",
        "qlinks",
        "qpaths",
        "qping",
        "qsend",
        "qstate",
        "qtrace",
    ]
