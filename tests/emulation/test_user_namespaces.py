"""Root of a host in its user namespace, and what it may do there; see user_namespaces(7)."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT, wait_until
from limits import SOON_S
from mininet.node import Node

from topologies.networks.network import Network

pytestmark = pytest.mark.image

HOSTS = "alice", "bob", "charlie"
NONE_TO_BE_HAD = (
    "echo 0 >/proc/sys/user/max_user_namespaces && "  # below the namespace of who says it
)
BELOW = ["unshare", "--user", "--map-root-user"]


def does(host: Node, command: str) -> bool:
    """Whether a command in a host's shell succeeds."""
    text: str = host.cmd(f"({command}) >/dev/null 2>&1; echo status=$?")
    return text.split()[-1] == "status=0"


def user_namespace_of(host: Node) -> str:
    text: str = host.cmd("readlink /proc/self/ns/user")
    return text.strip()


def test_each_host_has_one_with_the_users_of_this_machine(shared_network: Network) -> None:
    hosts = [shared_network.host(name) for name in HOSTS]
    found = {user_namespace_of(host) for host in hosts}
    assert len(found | {os.readlink("/proc/self/ns/user")}) == 1 + len(HOSTS)
    for ids in ("uid_map", "gid_map"):
        for line in hosts[0].cmd(f"cat /proc/self/{ids}").splitlines():
            inside, outside, _count = line.split()
            assert inside == outside


def test_a_command_is_where_the_shell_is(shared_network: Network) -> None:
    alice = shared_network.host("alice")
    kinds = ("user", "mnt", "net", "pid", "ipc")
    links = " ".join(f"/proc/self/ns/{kind}" for kind in kinds)
    text, errors, status = alice.pexec(f"readlink {links}", cwd=None)
    assert (errors, status) == ("", 0)
    assert text.split() == alice.cmd(f"readlink {links}").split()
    text, _errors, _status = alice.pexec("pwd", cwd=ROOT / "docs")
    assert text.strip() == str(ROOT / "docs")


def test_programs_of_the_run_are_in_none(shared_network: Network) -> None:
    """They can do what those of the host cannot, who could else read their memory."""
    for program in shared_network.runtime.programs:
        theirs = os.readlink(f"/proc/{program.pid}/ns/user")
        assert theirs == os.readlink("/proc/self/ns/user"), program.name


BEYOND_A_HOST = [
    'sysctl -w "vm.swappiness=$(sysctl -n vm.swappiness)"',
    'sysctl -w "kernel.core_pattern=$(sysctl -n kernel.core_pattern)"',
    "mount -o remount,bind,rw /proc/sys",
    "umount /proc/sys",
    "mount -t proc proc /mnt",
    "mount -t sysfs sysfs /mnt",
    "[ -w /sys/kernel ]",
    'date --set="@$(date +%s)"',
    "mknod /tmp/null-of-a-host c 1 3",
    "dmesg",
    'hostname "$(hostname)"',
    "unshare --cgroup true",
    "unshare --map-root-user --cgroup true",
    "ulimit -d unlimited",
]


def test_root_does_not_rule_the_machine(shared_network: Network) -> None:
    """Each would succeed, and change nothing, for root of this machine."""
    charlie = shared_network.host("charlie")
    assert [command for command in BEYOND_A_HOST if does(charlie, command)] == []


def test_not_even_what_it_can_name_is_open_to_it(shared_network: Network) -> None:
    """With the powers of charlie's root, where all processes of this machine are seen."""
    charlie, alice = (shared_network.host(name) for name in ("charlie", "alice"))
    asleep = [host.popen(["sleep", "60"], stdout=None, stderr=None) for host in (charlie, alice)]
    own, other = (each.pid for each in asleep)
    for pid in (own, other):
        comm = Path(f"/proc/{pid}/comm")
        wait_until(lambda: comm.read_text() == "sleep\n", "it is where its host is")  # noqa: B023
    enter = ["nsenter", "--target", str(own), "--user", "--preserve-credentials"]
    try:
        (stack,) = (each for each in shared_network.runtime.programs if each.name == "alice")
        for words, answers in (
            (["readlink", "/proc/{}/root"], [0, 1, 1]),
            (["head", "--bytes=1", "/proc/{}/environ"], [0, 1, 1]),
            (["nsenter", "--target", "{}", "--net", "true"], [0, 1, 1]),
        ):
            tried = [
                subprocess.run(
                    [*enter, *(word.format(pid) for word in words)],
                    capture_output=True,
                    check=False,
                    timeout=10,
                ).returncode
                for pid in (own, other, stack.pid)
            ]
            assert tried == answers, words
    finally:
        for each in asleep:
            each.kill()
            assert each.wait(5) == -signal.SIGKILL


def test_what_a_host_mounts_is_its_own(shared_network: Network, tmp_path: Path) -> None:
    alice, charlie = (shared_network.host(name) for name in ("alice", "charlie"))
    assert does(charlie, f"mount -t tmpfs own {tmp_path} && touch {tmp_path}/charlies")
    assert charlie.cmd(f"ls {tmp_path}").split() == ["charlies"]
    assert alice.cmd(f"ls {tmp_path}").split() == []
    assert list(tmp_path.iterdir()) == []
    assert does(charlie, f"umount {tmp_path}")


def test_root_sets_its_own_network_up(shared_network: Network) -> None:
    charlie = shared_network.host("charlie")
    for command in (
        "ip link add one type veth peer name two",
        "ip address add 10.9.0.1/24 dev one && ip link set one up && ip link set two up",
        "ip route add 10.8.0.0/24 via 10.9.0.2",
        "tc qdisc add dev one root tbf rate 1mbit burst 10kb latency 50ms",
        "sysctl -w net.ipv4.ip_forward=0",
        "ip tuntap add dev tap9 mode tap",
        "unshare --net ip link set lo up",
        "ip link del one && ip link del tap9",
    ):
        assert does(charlie, command), command
    assert "1 received" in charlie.cmd(f"ping -c 1 {shared_network.host('alice').IP()}")


def test_a_network_can_be_in_a_user_namespace_of_somebody_elses() -> None:
    """As in a container whose root is nobody outside; it has no other users."""
    program = (
        "from topologies.system.kernel.user_namespace import UserNamespace\n"
        "import subprocess\n"
        "made = UserNamespace()\n"
        "enter = ['nsenter', f'--user=/proc/self/fd/{made.descriptor}', '--preserve-credentials']\n"
        "command = [*enter, 'cat', '/proc/self/uid_map']\n"
        "subprocess.run(command, pass_fds=[made.descriptor], check=True)\n"
    )
    done = subprocess.run(
        [*BELOW, sys.executable, "-c", program],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=SOON_S,
    )
    assert done.stdout.split() == ["0", "0", "1"]


def test_there_is_one_for_hosts_beyond_the_first_thousand_open_files() -> None:
    program = (
        "import os, resource\n"
        "from topologies.system.kernel.user_namespace import UserNamespace\n"
        "_soft, most = resource.getrlimit(resource.RLIMIT_NOFILE)\n"
        "resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))\n"
        "files = [os.open(os.devnull, os.O_RDONLY) for _ in range(1_100)]\n"
        "print(UserNamespace().start(lambda: os.readlink('/proc/thread-self/ns/net')))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() not in ("", os.readlink("/proc/self/ns/net"))
