"""Hosts as Mininet has them, and what ends with those that are confined."""

import os
from pathlib import Path

import pytest
from conftest import wait_until
from fabric_scene import running
from test_confined_hosts import searched

from topologies.sdc import SdcTopo
from topologies.system.kernel import user_namespace

pytestmark = pytest.mark.image


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


def test_where_the_kernel_makes_no_user_namespaces_it_is_said_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """It refuses them below a user namespace whose root forbids them: user_namespaces(7)."""
    below = ["unshare", "--user", "--map-root-user", "sh", "-c"]
    refused = [*below, 'echo 0 >/proc/sys/user/max_user_namespaces && exec "$@"', "sh"]
    monkeypatch.setattr(user_namespace, "MAKE", [*refused, *user_namespace.MAKE])
    with running(SdcTopo, tmp_path) as network:
        alice, bob = network.host("alice"), network.host("bob")
        found = alice.cmd("readlink /proc/self/ns/user").strip()
        assert found == os.readlink("/proc/self/ns/user")
        for command in ("mount -t tmpfs own /mnt", "sysctl -w kernel.core_pattern=core"):
            assert "denied" in alice.cmd(command), command
        assert "1 received" in alice.cmd(f"ping -c 1 {bob.IP()}")
        assert alice.pexec("id -u")[0].strip() == "0"
        powers_and_memory = "grep CapBnd /proc/self/status; ulimit -d"
        shell = alice.cmd(powers_and_memory).split()
        assert alice.pexec(["sh", "-c", powers_and_memory])[0].split() == shell
        with open("/proc/self/status") as status:
            assert f"CapBnd:\t{shell[1]}\n" not in status.readlines()
        assert int(shell[2]) == alice.memory_mib << 10  # in KiB
    words = "no user namespaces (unshare: unshare failed: No space left on device)"
    assert caplog.text.count(words) == 1


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
