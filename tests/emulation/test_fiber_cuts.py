"""`link alice q1 down` is a fibre cut: light is lost, the controller hears of it."""

from io import StringIO

import pytest
from conftest import wait_until
from fabric_scene import session
from rich.console import Console

from hosts.quantum_socket import QuantumSocketError
from qmn.jobs.obstacle import lost_light
from topologies.networks.network import Network
from wire.controller_lines import read_record
from wire.metadata.vocabulary import Reason

CUT = r"^no light path from alice to bob: fibre alice-q1 \(alice-q0\) is cut$"


def known_cuts(network: Network) -> set[int]:
    """Return the ports of q1 that the controller knows to be down."""
    facts = [fact for fact in read_record(network.runtime.logs) if fact["event"] == "port"]
    up = {fact["at"]: fact["up"] for fact in facts}
    return {port for port in up if not up[port]}


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("host", ["alice", "bob", "charlie"])
def test_what_a_cut_has_cost_is_sent_again(shared_network: Network, host: str) -> None:
    network, data = shared_network, bytes(range(256)) * 4096
    log = network.runtime.logs / "quantum.log"
    earlier = log.read_text().count(" dark ")
    with session(network, "alice", "bob") as opened:
        network.net.configLinkStatus(host, "q1", "down")
        opened.start(data)
        wait_until(lambda: log.read_text().count(" dark ") > earlier, "light is lost")
        network.net.configLinkStatus(host, "q1", "up")
        assert opened.finish(len(data)) == data


def test_a_session_that_loses_its_light_says_so_at_once_and_when_it_is_back(
    shared_network: Network,
) -> None:
    network, screen = shared_network, StringIO()
    with (
        lost_light(network, Console(file=screen)) as lost,
        session(network, "alice", "bob"),
    ):
        lost.look()  # at what other tests have left in the record

        def report(words: str) -> bool:
            lost.look()
            return screen.getvalue().endswith(words)

        before = len(screen.getvalue())
        network.net.configLinkStatus("alice", "q1", "down")
        wait_until(
            lambda: report("no light: fibre alice-q1 (alice-q0) is cut\n"), "the report of the cut"
        )
        network.net.configLinkStatus("alice", "q1", "up")
        wait_until(lambda: report("light is back\n"), "the report of the mended fibre")
        lost.look()
        assert screen.getvalue()[before:].count("\n") == 2


def test_a_session_over_a_cut_fibre_is_refused_until_it_is_mended(shared_network: Network) -> None:
    network = shared_network
    network.net.configLinkStatus("alice", "q1", "down")
    assert known_cuts(network)
    with (
        pytest.raises(QuantumSocketError, match=CUT) as caught,
        session(network, "alice", "bob"),
    ):
        pass
    assert caught.value.reason == Reason.FIBER_CUT
    network.net.configLinkStatus("alice", "q1", "up")
    assert not known_cuts(network)
    with session(network, "alice", "bob"):
        pass
