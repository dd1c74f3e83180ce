"""`qmn set fault` makes the quantum switch of a running network faulty, and whole again."""

from conftest import wait_until
from fabric_scene import session
from limits import SOON_S
from loaded import run_qmn

from topologies.networks.network import Network


def fault(*words: str) -> tuple[int, str]:
    """Run the verb; return its exit status and what it says."""
    done = run_qmn("set", "fault", *words, timeout_s=SOON_S)
    return done.returncode, done.stdout + done.stderr


def test_what_a_stuck_cross_connect_has_cost_is_sent_again(shared_network: Network) -> None:
    network, data = shared_network, bytes(range(256)) * 4096
    log = network.runtime.logs / "quantum.log"
    with session(network, "alice", "bob") as opened:
        # Light from charlie (port 5) goes to bob (port 4) and not to alice.
        assert fault("q1", "stuck", "5", "4") == (0, "q1: cross-connect 5 -> 4 is stuck\n")
        opened.start(data)
        wait_until(lambda: " 5 -> 2" in log.read_text(), "there was a path to alice")
        wait_until(lambda: "port=bob-q1" in log.read_text(), "light has come to bob instead")
        assert fault("q1", "repair") == (0, "q1: repaired, 25 C\n")
        assert opened.finish(len(data)) == data
