"""`qmn cli` from outside, and scripts, over the real components."""

import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from conftest import ROOT, verb, wait_until
from limits import PROGRAM_S, SOON_S
from loaded import run_qmn
from test_metrics_of_a_run import counted, metrics
from test_timeline_of_a_run import fields

from qmn.interactive.quantum_cli import QuantumCLI
from qmn.jobs.transfer import TransferError
from qmn.options import BadInput
from qmn.scripting import start
from topologies.chain import ChainTopo
from wire.controller_lines import read_record
from wire.outcomes import Pauli

KEYBOARD_S = SOON_S


def cli(script: str, *options: str, runs: Path) -> subprocess.CompletedProcess[str]:
    """Run a script to its end."""
    return run_qmn("cli", *options, "--runs", str(runs), commands=script, timeout_s=PROGRAM_S)


@pytest.mark.image
def test_every_verb_works_from_a_script(tmp_path: Path) -> None:
    script = """
        # our own verbs
        qpaths
        alice qsend bob hello over light
        qping alice bob 3
        qiperf alice bob 1
        qlinks
        alice qstate
        qtrace alice bob
        # Mininet's
        nodes
        alice ping -c1 -W5 bob
        pingall
        iperf alice bob
        dpctl dump-flows
        ed timeout 30 python -m qmn spy --no-follow --kind bell-measure
        q1 timeout 30 python -m qmn spy --no-follow --node=q1 --kind open
        sh echo from the shell
        py network.send('alice', 'bob', b'from py').data
        help qtrace
    """
    options = ("sdc", "--length-km", "2", "--loss-db-per-km", "0.1")
    done = cli(script, *options, runs=tmp_path)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr + done.stdout
    shown = done.stdout
    assert "bob: hello over light\n16 bytes, " in shown
    assert "3 rounds, 3 delivered" in shown
    report = re.search(r"alice to bob: (\d+\.\d+) s, [\d,]{5,} pairs, [\d,]{4,} pairs/s, ", shown)
    assert report is not None
    assert float(report[1]) >= 1  # as long as was asked, and more on a busy machine
    assert "light paths: none" in shown
    assert re.search(r"alice-q0 +q1:\d +2 km +0\.2 dB +whole +[\d,]{4,} +[\d,]{4,}", shown)
    assert "blocks: none" in shown
    assert re.search(r"alice-q0 to bob-q\d: 0\.4 dB, rotation I", shown)
    assert len(re.findall(r"charlie-q\d to \w+-q\d: 0\.4 dB", shown)) == 2
    assert "1 packets transmitted, 1 received" in shown
    assert "0% dropped" in shown
    assert re.search(r"Results: \['[\d.]+ \wbits/sec', '[\d.]+ \wbits/sec'\]", shown)
    assert len(re.findall(r"\*\*\* [qs]1 -+\n cookie=0x", shown)) == 2
    assert re.search(r"Z bob +bell-measure", shown)  # from node ed
    assert re.search(r"Z q1 +open", shown)
    assert "b'from py'" in shown
    assert "Usage: qtrace" in shown


def test_stepped_time_at_the_prompt_never_leads_the_wall(tmp_path: Path) -> None:
    """Programs with timers of their own go on: their pauses are the wall's."""
    script = "alice ping -c3 -i0.5 bob\nalice qsend bob hello\nalice qping bob 3\n"
    began_s = time.monotonic()
    done = cli(script, "sdc", "--time", "stepped", runs=tmp_path)
    passed_s = time.monotonic() - began_s
    assert (done.returncode, done.stderr) == (0, ""), done.stderr + done.stdout
    assert "3 packets transmitted, 3 received" in done.stdout
    assert "bob: hello\n5 bytes, " in done.stdout
    assert "3 rounds, 3 delivered" in done.stdout
    assert json.loads((tmp_path / "latest/result.json").read_text())["time"] == "stepped"
    log = (tmp_path / "latest/gate.log").read_text()
    stopped = re.search(r"stopped: [\d,]+ leaps, 0 wrong, at 1,([\d.]+) s", log)
    assert stopped is not None
    assert float(stopped[1]) < passed_s


def test_a_script_goes_on_after_failures_and_its_status_tells(tmp_path: Path) -> None:
    script = """
        link alice q1 down
        alice qsend bob lost
        alice false
        qlinks
        link alice q1 up
        alice true
    """
    done = cli(script, "sdc", runs=tmp_path)
    assert done.returncode == 1
    refused, false = done.stderr.splitlines()
    assert "no path" in refused or "cut" in refused
    assert false == "*** alice false: status 1"
    assert re.search(r"alice-q0 .* cut ", done.stdout)


def test_a_shell_that_ends_and_bytes_of_no_encoding_end_nothing_else(tmp_path: Path) -> None:
    script = """
        alice printf "\\351t\\351\\n"
        alice exit
        alice echo never
        bob exec true
        bob echo never
        charlie echo still here
        alice qsend bob over light
    """
    done = cli(script, "sdc", runs=tmp_path)
    assert done.returncode == 1
    ended = "died in mid-run: its shell was ended; start the network again"
    assert done.stderr.splitlines() == [
        f"*** {name} {ended}" for name in 2 * ["alice"] + 2 * ["bob"]
    ]
    assert "\N{REPLACEMENT CHARACTER}t\N{REPLACEMENT CHARACTER}\n" in done.stdout
    assert "still here\n" in done.stdout
    assert "bob: over light\n" in done.stdout


def test_switch_start_is_over_when_the_controller_has_heard_of_it(tmp_path: Path) -> None:
    with start("sdc", folder=tmp_path) as network:
        cli = QuantumCLI(network, [])
        for name, dpid in (("q1", 0x1001), ("s1", 1)):
            cli.onecmd(f"switch {name} stop")
            cli.onecmd(f"switch {name} start")
            facts = [fact for fact in read_record(tmp_path) if fact.get("dpid") == dpid]
            assert [fact["event"] for fact in facts].count("switch") == 2
            cli.onecmd(f"switch {name} start")  # nothing new is waited for
        assert cli.failures == 0


def test_ctrl_c_ends_the_verb_and_ctrl_d_the_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And what the network leaves is of who has called sudo."""
    monkeypatch.setenv("SUDO_UID", "65534")
    with Keyboard("sdc", "--metrics", "--runs", str(tmp_path)) as keyboard:
        shown = keyboard.read_until("qmn> ", SOON_S)
        addresses = dict(re.findall(r"metrics of (\S+): (http://\S+)", shown))
        assert addresses.keys() == {"dispatcher", "q1-agent", "c0"}
        keyboard.type("qiperf alice bob 60\n")
        keyboard.read_until("qiperf alice bob 60")
        begun = partial(counted, addresses["dispatcher"], "qmn_pairs_created_total")
        wait_until(begun, "the transfer is under way")
        keyboard.type("\x03")
        keyboard.read_until("Interrupt")
        keyboard.read_until("qmn> ")
        keyboard.type("alice qsend bob still here\n")
        keyboard.read_until("10 bytes")
        keyboard.read_until("qmn> ")
        assert metrics(addresses["dispatcher"])["qmn_pairs_created_total"] >= 40
        assert metrics(addresses["c0"])["qmn_path_setup_seconds_count"] == 2
        keyboard.type("qst\t al\t\n")
        keyboard.read_until("blocks: none")
        keyboard.read_until("qmn> ")  # Ctrl-D means the end only to who reads just then
        keyboard.type("\x04")
        assert keyboard.ended() == 0
    assert {path.lstat().st_uid for path in tmp_path.rglob("*")} == {65534}


def test_a_signal_ends_the_network_in_mid_command_and_what_was_captured_stays(
    tmp_path: Path,
) -> None:
    with Keyboard("sdc", "--captures", "full", "--runs", str(tmp_path), "--seed", "5") as keyboard:
        keyboard.read_until("qmn> ", SOON_S)
        keyboard.type("alice qsend bob seen\n")
        keyboard.read_until("4 bytes")
        keyboard.read_until("qmn> ")
        keyboard.type("alice sleep 61.5\n")
        sleeping = ["pgrep", "-f", "^sleep 61.5$"]  # the shell does nothing else meanwhile
        wait_until(lambda: subprocess.run(sleeping, capture_output=True).returncode == 0, "sleep")
        os.kill(keyboard.pid, signal.SIGTERM)
        keyboard.read_until("interrupted by SIGTERM; everything is cleaned up")
        assert keyboard.ended() == 128 + signal.SIGTERM
    run = tmp_path / "latest"
    verdicts = fields(run, 'qmeta.service == "SDC"', "frame.interface_name", "qmeta.verdict")
    assert verdicts == [("s1-eth1", "0"), ("s1-eth2", "1")]
    assert ("c0",) in fields(run, "openflow_v5", "frame.interface_name")
    log = (run / "quantum.log").read_text().splitlines()
    assert len(fields(run, "qevent", "qevent.kind")) == len(log) > 10
    # Following ends, because result.json says that this network has ended.
    spied = verb("spy", str(run), "--follow")
    assert spied.stdout.splitlines() == log
    assert "all.pcapng" in verb("wireshark", str(run)).stdout
    result = json.loads((run / "result.json").read_text())
    assert (result["topology"], result["seed"]) == ("sdc", 5)
    assert result["error"] == "interrupted by SIGTERM"
    assert {Path(file).stem for file in result["captures"]} >= {"c0", "s1-eth1", "s1-eth5"}
    assert result["packets_not_captured"] == 0


class Keyboard:
    """`qmn cli` at a terminal of its own."""

    def __init__(self, *arguments: str) -> None:
        self._command = [sys.executable, "-m", "qmn", "cli", *arguments]

    def __enter__(self) -> "Keyboard":
        self.pid, self._terminal = pty.fork()
        if self.pid == 0:
            os.chdir(ROOT)
            os.execv(self._command[0], self._command)  # noqa: S606
        self._seen = ""
        return self

    def type(self, text: str) -> None:
        """Press keys."""
        os.write(self._terminal, text.encode())

    def read_until(self, text: str, timeout_s: float = KEYBOARD_S) -> str:
        """Read what is shown until this is, within the deadline; return what came before."""
        deadline = time.monotonic() + timeout_s
        while text not in self._seen:
            wait_s = max(0.0, deadline - time.monotonic())
            ready = select.select([self._terminal], [], [], wait_s)[0]
            assert ready, f"not seen: {text!r} in {self._seen!r}"
            try:
                self._seen += os.read(self._terminal, 4096).decode(errors="replace")
            except OSError as error:
                raise AssertionError(f"ended without {text!r}: {self._seen!r}") from error
        before, _, self._seen = self._seen.partition(text)
        return before

    def ended(self) -> int:
        """Return its status when it has ended, within the deadline."""
        deadline = time.monotonic() + KEYBOARD_S
        while select.select([self._terminal], [], [], max(0.0, deadline - time.monotonic()))[0]:
            try:
                os.read(self._terminal, 4096)
            except OSError:
                break  # the terminal of a process that has ended
        else:
            os.kill(self.pid, signal.SIGKILL)
        status = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        self.pid = 0
        return status

    def __exit__(self, *_error: object) -> None:
        if self.pid:
            os.kill(self.pid, signal.SIGTERM)
            self.ended()
        os.close(self._terminal)


@pytest.mark.nightly
def test_the_script_of_the_documentation_runs(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "scripting.md").read_text()
    program = re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0]
    assert program.count("\n") < 15
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=PROGRAM_S,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "b'hello'" in done.stdout
    assert "['fibre', 'q1', 'fibre']" in done.stdout


def test_a_script_reads_results_of_a_topology_of_its_own(tmp_path: Path) -> None:
    data = os.urandom(3000)
    with start(lambda: ChainTopo(switches=2, depolarizing=0.001), folder=tmp_path) as network:
        result = network.send("alice", "bob", data, frame_bytes=32)
        assert (result.data, result.size) == (data, 3000)
        assert 0 < result.symbol_errors < 0.05 * result.received_symbols
        to_bob = next(p for p in network.trace("alice", "bob") if p.hops[0].begin == "alice-q0")
        assert [hop.what for hop in to_bob.hops] == ["fibre", "q1", "fibre", "q2", "fibre"]
        assert to_bob.rotation is Pauli.I
        fibers = {(fiber.a, fiber.b): fiber for fiber in network.fibers()}
        assert len(fibers) == len(network.runtime.fibers)
        alice = next(fiber for fiber in fibers.values() if fiber.a == "alice-q0")
        # The photons pass alice's fibre to her and, encoded, on to bob.
        assert alice.photons_to_a == alice.photons_to_b == result.bell_pairs
        network.sleep(2)  # devices report every second
        wait_until(
            lambda: network.state("bob").device.get("pairs_received") == result.bell_pairs,
            "bob's device has reported what it received",
        )
        with pytest.raises(BadInput, match="unknown host 'ed'"):
            network.send("alice", "ed", b"")
        network.net.configLinkStatus("alice", "q1", "down")
        with pytest.raises(TransferError):
            network.send("alice", "bob", b"lost")
    assert (tmp_path / "quantum.log").exists()


@pytest.mark.nightly
def test_a_network_in_the_folder_of_an_earlier_one_begins_anew(tmp_path: Path) -> None:
    found = []
    for message in (b"first", b"second"):
        with start("sdc", folder=tmp_path) as network:
            assert network.send("alice", "bob", message).data == message  # its fibres are found
            fibers = len(network.runtime.fibers)
        facts = [fact["event"] for fact in read_record(tmp_path)]
        found.append((facts.count("fiber"), facts.count("path_ready")))
    assert found == [(fibers, 1)] * 2
