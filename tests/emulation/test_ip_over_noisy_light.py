"""q0 over several switches, with noise, loss, a code, and a policy that denies some of it."""

import re
from functools import partial
from pathlib import Path

from conftest import wait_until
from fabric_scene import light_paths, running
from test_ip_over_light import DARK_S, answered, pinged, pings, run

from applications.ip_over_light.interfaces import IpOverLight, start_ip_over_light
from topologies.ring import RingTopo

DENY_CHARLIE = "[[rule]]\naction = 'deny'\nto = 'charlie'\n"


def test_packets_pass_a_noisy_ring_by_a_code_and_policy_is_told(tmp_path: Path) -> None:
    policy = tmp_path / "policy.toml"
    policy.write_text(DENY_CHARLIE)
    topo = partial(RingTopo, both_ways=True, depolarizing=0.01, loss_db_per_km=0.2)
    with running(topo, tmp_path, policy=str(policy)) as network:
        sessions = {"fec": "golay", "interleave": True, "frame_bytes": 64}
        start_ip_over_light(network, IpOverLight(sessions=sessions, idle_s=0.5))
        assert answered(run(network, "bob", pings(3, "-s 1000 10.1.0.1"))) == 3
        assert sum(len(light_paths(f"q{n}")) for n in range(1, 5)) > 4
        assert "Packet filtered" in pinged(network, "alice", "-c 1 10.1.0.3")
        wait_until(lambda: not light_paths("q1"), "light given back", DARK_S)
        log = network.runtime.logs / "q0-bob.log"
        given_back = re.compile(r"given back \(sdc\).*; (\d+) bytes, (\d+) pairs")
        wait_until(lambda: given_back.search(log.read_text()), "a line of the log", DARK_S)
        (logged,) = given_back.findall(log.read_text())
        # Golay (23,12) makes 23 bits of 12; two bits a pair.
        assert int(logged[1]) > 4 * int(logged[0]) * 23 / 12
