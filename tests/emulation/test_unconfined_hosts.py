"""Hosts as Mininet has them, and what ends with those that are confined."""

import os
from pathlib import Path

from conftest import wait_until
from fabric_scene import running
from test_confined_hosts import searched

from topologies.sdc import SdcTopo


def test_what_hosts_of_mininet_see_is_found(tmp_path: Path) -> None:
    """So the search finds what it looks for where hosts are not confined."""

    def topo() -> SdcTopo:
        made = SdcTopo()
        made.setNodeInfo("charlie", {**made.nodeInfo("charlie"), "confined": False})
        return made

    with running(topo, tmp_path) as network:
        found = searched(network, "charlie")
    for words in ("alice.json holds", "connected to", "sees process"):
        assert words in found


def test_all_that_a_host_has_started_ends_with_it(tmp_path: Path) -> None:
    """Without a mark in its environment, as a daemon, and deaf to signals, too."""
    with running(SdcTopo, tmp_path) as network:
        bob = network.host("bob")
        bob.cmd("trap '' HUP TERM; env -i setsid sleep 987654 & trap - HUP TERM")
        wait_until(lambda: sleepers(), "it sleeps")
    wait_until(lambda: not sleepers(), "it has ended")


def sleepers() -> list[str]:
    """Return the processes of this machine that sleep so long."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            if folder.name.isdigit() and b"987654" in (folder / "cmdline").read_bytes():
                found.append(folder.name)
        except OSError:
            continue  # it has ended
    return [pid for pid in found if os.path.exists(f"/proc/{pid}")]
