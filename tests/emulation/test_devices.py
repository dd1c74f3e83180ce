"""The controller's knowledge of devices and paths, and how it sets hosts."""

import json
import subprocess
import sys
from typing import Any

import pytest
from conftest import ROOT, policy, policy_of, wait_until
from fabric_scene import session
from limits import SOON_S
from loaded import run_qmn

from hosts.quantum_socket import QuantumSocket, QuantumSocketError
from topologies.networks.network import Network
from wire.metadata.vocabulary import Reason


def qmn(*words: str) -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    return run_qmn(*words, timeout_s=SOON_S)


def devices() -> dict[str, Any]:
    """Return what `qmn devices --json` says, by name."""
    done = qmn("devices", "--json")
    assert done.returncode == 0, done.stderr
    return {device["name"]: device for device in json.loads(done.stdout)}


def test_every_device_is_known_and_a_pulse_rate_is_overridden(shared_network: Network) -> None:
    network = shared_network
    before = devices()
    wait_until(
        lambda: all(device["state"] == "up" for device in devices().values()), "all devices heard"
    )
    assert set(devices()) == {"q1", "alice", "bob", "charlie"}
    assert [port["up"] for port in devices()["bob"]["ports"]] == [True, True]
    done = qmn("set", "host", "alice", "rate-hz", "1000000")
    assert (done.returncode, done.stdout) == (
        0,
        "alice: overridden in new sessions: rate_hz 1000000\n",
    )
    with QuantumSocket(network.runtime.socket("bob")) as listener:
        listener.listen(7)
        with QuantumSocket(network.runtime.socket("alice")) as sender:
            sender.connect(("bob", 7), rate_hz=50_000_000)
            assert sender.statistics["rate_hz"] == 1_000_000
            paths = json.loads(qmn("paths", "--json").stdout)
            ends = {(path["begin"], path["end"]) for path in paths["paths"]}
            assert ends == {
                ("charlie-q0", "alice-q0"),
                ("alice-q0", "bob-q1"),
                ("charlie-q1", "bob-q0"),
            }
            (session,) = paths["sessions"]
            assert (session["from"], session["to"], session["source"]) == (
                "alice",
                "bob",
                "charlie",
            )
            assert session["rate_hz"] == 1_000_000
            receiver, _peer = listener.accept()
            sender.sendall(b"counted")
            counters = {"alice": "pairs_sent", "bob": "pairs_received", "charlie": "pairs_made"}
            wait_until(
                lambda: all(
                    devices()[host].get(name, 0) - before[host].get(name, 0) == 28
                    for host, name in counters.items()
                ),
                "pairs in all reports",
            )
            known = devices()
            assert known["alice"]["in_use"]["rate_hz"] == 1_000_000
            assert known["alice"]["sessions"] == {"sending": 1, "receiving": 0, "serving": 0}
            wait_until(lambda: len(devices()["q1"]["paths"]) == 3, "the paths of q1 in its report")
            receiver.close()
    wait_until(lambda: not devices()["q1"]["paths"], "no paths in the report of q1")
    assert qmn("set", "host", "alice", "rate-hz", "default").stdout == (
        "alice: overridden in new sessions: nothing\n"
    )


def test_a_refused_setting_a_cut_and_a_silent_host_are_told(shared_network: Network) -> None:
    network = shared_network
    wait_until(
        lambda: all(device["state"] == "up" for device in devices().values()), "all devices heard"
    )
    for words, text in (
        (("alice", "fec", "9"), "alice: fec 9 is not known: choose one of none, repetition"),
        (("eve", "fec", "0"), "no device 'eve'; hosts with a node agent: alice, bob, charlie"),
        (("q1", "fec", "0"), "q1 is a switch"),
        (("alice", "rate-hz", "0"), "rate_hz 0: choose 1 to 4000000000"),
        (("alice", "rate-hz", "fast"), "rate_hz is 'fast': give a whole number, or `default`"),
    ):
        done = qmn("set", "host", *words)
        assert done.returncode == 1
        assert text in done.stderr
    assert devices()["alice"]["overrides"] == {}
    network.net.configLinkStatus("bob", "q1", "down")
    wait_until(
        lambda: [port["up"] for port in devices()["bob"]["ports"]] == [False, False],
        "bob reports the cut",
    )
    wait_until(
        lambda: sum(not port["up"] for port in devices()["q1"]["ports"]) == 2, "q1 reports the cut"
    )
    network.net.configLinkStatus("bob", "q1", "up")
    network.net.configLinkStatus("charlie", "s1", "down")
    wait_until(lambda: devices()["charlie"]["state"] == "silent", "charlie is silent")
    assert "silent since" in qmn("devices").stdout
    network.net.configLinkStatus("charlie", "s1", "up")
    wait_until(lambda: devices()["charlie"]["state"] == "up", "charlie is heard again")


def test_hosts_cannot_set_each_other(shared_network: Network) -> None:
    network = shared_network
    wait_until(lambda: devices()["bob"]["state"] == "up", "bob is heard")
    send = (
        "import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM);"
        "[s.sendto(bytes(200), ('10.0.0.2', 9012)) for _ in range(3)];"
        # A fragment has no ports that a switch could see.
        "s.sendto(bytes(4000), ('10.0.0.2', 9012))"
    )
    assert network.host("alice").cmd(f'{sys.executable} -c "{send}"') == ""
    log = network.runtime.logs / "bob.log"
    wait_until(lambda: "dropped, from 10.0.0.1" in log.read_text(), "the fragment is dropped")
    assert log.read_text().count("dropped, from 10.0.0.1") == 1


def connect(network: Network, sender: str, receiver: str) -> None:
    """Open a session and leave it."""
    with session(network, sender, receiver):
        pass


def test_the_policy_decides_until_it_is_changed(shared_network: Network) -> None:
    network, file = shared_network, policy_of(shared_network)
    with policy(network, (ROOT / "controller_apps/policy/deny.toml").read_text()):
        connect(network, "alice", "bob")
        with pytest.raises(QuantumSocketError, match="policy does not allow") as caught:
            connect(network, "bob", "alice")
        assert caught.value.reason == Reason.NOT_ALLOWED
        file.write_text("default = 'deny'\n[[rule]]\naction = 'perhaps'")
        done = qmn("set", "policy", "reload")
        assert "rule 1: action 'perhaps'" in done.stderr
        connect(network, "alice", "bob")
        file.write_text("default = 'deny'\n[device.bob]\nframe_bytes = 64")
        assert qmn("set", "policy", "reload").stdout == f"in force: {file}\n"
        with pytest.raises(QuantumSocketError, match="policy does not allow"):
            connect(network, "alice", "bob")
        wait_until(lambda: devices()["bob"].get("overrides") == {"frame_bytes": 64}, "bob is set")
    wait_until(lambda: devices()["bob"].get("overrides") == {}, "bob is as before")
