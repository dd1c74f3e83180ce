"""A controller that is killed and started again: what lives goes on, what is dead is removed."""

import hashlib
import re
import subprocess
import threading
import time
from itertools import pairwise
from pathlib import Path
from statistics import median

import pytest
from conftest import wait_until
from fabric_scene import Session, facts, light_paths, restarted_agent, running, session
from limits import SOON_S
from loaded import forks

from hosts.quantum_socket import QuantumSocketError
from topologies.networks.network import Network
from topologies.ring import RingTopo
from topologies.sdc import SdcTopo
from topologies.system.processes.programs import python
from topologies.timeouts import READY_TIMEOUT_S
from wire.metadata.vocabulary import Reason

BOTH = pytest.mark.parametrize("framework", ["ryu", "os-ken"])
RYU = pytest.mark.parametrize("framework", ["ryu"])
DATA = hashlib.shake_256(b"light").digest(12 << 20)  # some seconds of light
LESS = DATA[: 1 << 14]
PAIRED = 64  # bytes, each pair of which has light of its own
ASKED_S = 15.0  # hosts are asked as soon as they are heard, every second


def start_again(network: Network) -> None:
    """Start a controller like the one that has ended, and wait until both switches are here."""
    (c0,) = network.net.controllers
    before = len(facts(network, "switch"))
    config = network.runtime.folder / "c0.json"
    command = [python(), "-m", "controller_apps", "--config", str(config)]
    command += ["--framework", network.runtime.settings.controller]
    c0.program.start(command, c0.pid, forks=forks())
    switches = len(network.net.switches)
    wait_until(
        lambda: len(facts(network, "switch")) == before + switches,
        "every switch is here again",
        READY_TIMEOUT_S,
    )


def kill(network: Network) -> None:
    """End the controller as a crash would."""
    (c0,) = network.net.controllers
    c0.program.kill()


def bypasses(network: Network) -> list[str]:
    """Return the cookies of the entries that let connections pass s1."""
    command = ["ovs-ofctl", "-O", "OpenFlow14", "dump-flows", "s1", "table=1"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=SOON_S)
    return re.findall(r"cookie=0x([0-9a-f]+).*priority=300,", done.stdout)


def kept(network: Network) -> list[str]:
    """Return the sessions that the controller has kept for its successor."""
    files = (network.runtime.folder / "state").iterdir()
    return sorted(file.name for file in files if file.name != "hosts")


class Watch:
    """Looks at the light entries of a switch all the time; notes all states they had."""

    def __init__(self, switch: str) -> None:
        self.seen: list[dict[int, int]] = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, args=(switch,))

    def _look(self, switch: str) -> None:
        while not self._over.wait(0.01):
            self.seen.append(light_paths(switch))

    def __enter__(self) -> "Watch":
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._over.set()
        self._thread.join(10)


@pytest.mark.by_day(every=2)
@BOTH
def test_a_framed_session_outlives_the_controller_in_full_light(
    tmp_path: Path, framework: str
) -> None:
    with running(SdcTopo, tmp_path, controller=framework) as network:
        with session(network, "alice", "bob") as opened:
            opened.start(DATA)
            wait_until(lambda: len(bypasses(network)) == 2, "data has followed the set-up")
            before = light_paths("q1")
            with Watch("q1") as watch:
                kill(network)
                start_again(network)
                second = Session(network, "alice", "bob", port=8)
                with pytest.raises(QuantumSocketError, match="another session uses") as caught:
                    second.open()
                second.close()
            assert opened.sending
            assert caught.value.reason == Reason.BUSY
            assert len(before) == 3
            assert watch.seen
            assert all(paths == before for paths in watch.seen)
            assert len(set(bypasses(network))) == 1
            received = opened.finish(len(DATA))
            assert hashlib.sha256(received).digest() == hashlib.sha256(DATA).digest()
            assert light_paths("q1") == before
            assert facts(network, "torn_down") == []
        (resumed,) = facts(network, "resumed")
        wait_until(lambda: not light_paths("q1"), "the new controller closes the paths")
        wait_until(lambda: not bypasses(network), "nothing passes s1 by itself")
        over = {(fact["session"], fact["detail"]) for fact in facts(network, "torn_down")}
        assert over == {(resumed["session"], "FIN")}  # of each of its connections
        assert kept(network) == []
        with session(network, "alice", "bob", port=9) as third:
            assert third.carry(LESS) == LESS


@pytest.mark.nightly
@RYU
def test_light_over_several_switches_stays_where_it_is(tmp_path: Path, framework: str) -> None:
    with (
        running(RingTopo, tmp_path, controller=framework) as network,
        session(network, "alice", "bob") as opened,
    ):
        assert opened.carry(LESS) == LESS
        before = {name: light_paths(name) for name in network.runtime.switches}
        kill(network)
        start_again(network)
        assert opened.carry(LESS) == LESS
        assert {name: light_paths(name) for name in network.runtime.switches} == before
        assert facts(network, "moved") == facts(network, "stranded") == []


@pytest.mark.nightly
@BOTH
def test_a_per_pair_session_outlives_the_controller(tmp_path: Path, framework: str) -> None:
    with running(SdcTopo, tmp_path, controller=framework) as network:
        with session(network, "alice", "bob", handshake="per-pair") as opened:
            opened.start(LESS[:PAIRED])
            wait_until(lambda: len(facts(network, "path_ready")) > 50, "pairs are on their way")
            kill(network)
            assert len(facts(network, "path_ready")) < 4 * PAIRED
            start_again(network)
            assert opened.finish(PAIRED) == LESS[:PAIRED]
            assert len(facts(network, "path_ready")) >= 4 * PAIRED  # four pairs a byte
        assert facts(network, "resumed")
        assert facts(network, "refused") == []
        wait_until(lambda: not light_paths("q1"), "the paths are closed")
        wait_until(lambda: not kept(network), "the session is over")
        assert {fact["detail"] for fact in facts(network, "torn_down")} <= {"FIN", "RST"}


@RYU
def test_a_framed_session_outlives_an_agent_that_is_killed(tmp_path: Path, framework: str) -> None:
    with (
        running(SdcTopo, tmp_path, controller=framework) as network,
        session(network, "alice", "bob") as opened,
    ):
        before = light_paths("q1")
        opened.start(DATA)
        wait_until(lambda: len(bypasses(network)) == 2, "data has followed the set-up")
        with restarted_agent(network, "q1"):
            pass
        assert light_paths("q1") == before
        assert opened.sending
        assert opened.finish(len(DATA)) == DATA
        assert facts(network, "torn_down") == []


@pytest.mark.nightly
@RYU
def test_between_two_sessions_a_controller_may_be_away(tmp_path: Path, framework: str) -> None:
    with running(SdcTopo, tmp_path, controller=framework) as network:
        with session(network, "alice", "bob") as first:
            assert first.carry(LESS) == LESS
        wait_until(lambda: facts(network, "torn_down"), "the first is over")
        # This is known before all is deleted: who is stopped then leaves it to the next controller.
        wait_until(lambda: not light_paths("q1"), "its paths are closed")
        wait_until(lambda: not bypasses(network) and not kept(network), "nothing is left of it")
        (c0,) = network.net.controllers
        c0.program.stop()
        time.sleep(5.0)
        start_again(network)
        with session(network, "alice", "bob") as second:
            assert second.carry(LESS) == LESS
        assert facts(network, "resumed") == []


@pytest.mark.waits
def test_a_switch_looks_for_its_controller_every_second(tmp_path: Path) -> None:
    """Open vSwitch by itself would after 1, 2, 4 and 8 s (ovs-vswitchd.conf.db(5), max_backoff)."""
    with running(SdcTopo, tmp_path) as network:
        (c0,) = network.net.controllers
        first = "tcp[tcpflags] == tcp-syn and dst port 6653"
        tcpdump = ["tcpdump", "-i", "c0-s1", "-n", "-l", "-tt", "-c", "8", first]
        with c0.popen(tcpdump, text=True, stderr=subprocess.DEVNULL) as capture:
            kill(network)
            came = [float(line.split()[0]) for line in capture.stdout]
    assert len(came) == 8
    assert median(later - earlier for earlier, later in pairwise(came)) < 1.5, came


@RYU
def test_a_session_that_ends_unseen_is_over_when_its_hosts_are_asked(
    tmp_path: Path, framework: str
) -> None:
    """A bypass falls silent after 30 s."""
    with running(SdcTopo, tmp_path, controller=framework) as network:
        with session(network, "alice", "bob") as opened:
            assert opened.carry(LESS) == LESS
            kill(network)
        start_again(network)
        wait_until(lambda: not light_paths("q1"), "the paths are closed", ASKED_S)
        wait_until(lambda: facts(network, "torn_down"), "the end is recorded", ASKED_S)
        (over,) = facts(network, "torn_down")
        assert over["detail"] == "ended while no controller was there"
        wait_until(lambda: not bypasses(network) and not kept(network), "nothing is left of it")
        with session(network, "alice", "bob", port=8) as second:
            assert second.carry(LESS) == LESS
