"""A program on one host that looks for another's secrets and processes, and what it finds."""

import os
import re
import signal
import sys
from pathlib import Path
from subprocess import DEVNULL

import pytest
from conftest import ROOT, wait_until

from topologies.networks.network import Network
from topologies.system.open_vswitch import openvswitch

pytestmark = pytest.mark.image

SEARCH = """
import os, socket, sys
folders, sockets, words = (each.split(",") for each in sys.argv[1:])
found = []
for top in folders:
    for path, _folders, files in os.walk(top):
        for name in files:
            try:
                with open(os.path.join(path, name), "rb") as file:
                    data = file.read()
                found += [f"{name} holds {word}" for word in words if word.encode() in data]
            except OSError:
                pass
for each in sockets:
    try:
        socket.socket(socket.AF_UNIX).connect(each)
        found.append(f"connected to {each}")
    except OSError:
        pass
for pid in os.listdir("/proc"):
    if pid.isdigit():
        with open(f"/proc/{pid}/cmdline") as command:
            packages = {word.partition(".")[0] for word in command.read().split("\\0")}
            if packages & {"hosts", "dispatcher", "qswitch_agent"}:
                found.append(f"sees process {pid}")
print("found=" + "; ".join(found))
"""


def searched(network: Network, host: str) -> str:
    """Let a host look for what is alice's, and for what programs the switches."""
    runtime = network.runtime
    script = runtime.logs.parent / "search.py"
    script.write_text(SEARCH)
    sockets = [runtime.socket(name) for name in ("alice", "dispatcher", "console", "q1-bridge")]
    sockets += [str(openvswitch.RUN_FOLDER / "db.sock")]
    words = [runtime.token("alice"), runtime.device_key("alice"), runtime.token("ed")]
    folders = [str(runtime.folder), str(runtime.logs)]
    given = (",".join(each) for each in (folders, sockets, words))
    output = network.host(host).cmd(f"{sys.executable} {script} {' '.join(given)}")
    found = re.search(r"found=(.*)", output)
    assert found, output
    return found[1].strip()


def test_a_program_on_one_host_finds_nothing_of_another(shared_network: Network) -> None:
    assert searched(shared_network, "charlie") == ""


def test_signals_to_everybody_reach_only_ones_own(shared_network: Network) -> None:
    charlie = shared_network.host("charlie")
    asleep = charlie.popen(["sleep", "60"], stdout=None, stderr=None)
    charlie.cmd("kill -STOP -1; kill -KILL -1")
    assert asleep.wait(5) == -signal.SIGKILL
    assert not any(program.stopped for program in shared_network.runtime.programs)
    shared_network.check()  # all run


def test_nothing_takes_the_covers_off(shared_network: Network) -> None:
    """In a user namespace they are locked; without one, who mounts needs what was given up."""
    charlie, folder = shared_network.host("charlie"), shared_network.runtime.folder
    own = sorted(path.name for path in folder.iterdir())
    assert "alice.json" in own
    for command in (
        "umount /run/qmn",
        "unshare --map-root-user --mount umount /run/qmn",
        "unshare --map-root-user --mount bash -c 'mount --bind / /mnt && cd /mnt'",
        "umount --lazy /run",
        "umount /dev/shm",
        "umount /dev/pts",
        "mount -o remount,rw /run/qmn",
        "mount --move /run/qmn /mnt",
        "mount --bind / /mnt",
        "mount -t overlay -o lowerdir=/run/qmn:/run none /mnt && ls /mnt/qmn/*/alice.json",
        "nsenter --target 1 --mount ls /run/qmn/*/alice.json",
        "touch /run/qmn/mine",
    ):
        assert charlie.cmd(f"{command}; echo status=$?").strip()[-1] != "0", command
        assert charlie.cmd(f"ls {folder}").split() == ["charlie", "keys", "written"]


def test_what_is_shown_to_a_host_it_cannot_change(shared_network: Network) -> None:
    """Else it would leave links there to what is hidden, and its key manager follow them."""
    charlie, runtime = shared_network.host("charlie"), shared_network.runtime
    hidden = runtime.folder / "dispatcher.json"
    assert runtime.token("alice") in hidden.read_text()
    own, keys = runtime.own_folder("charlie"), Path(runtime.key_folder("charlie"))
    (keys / "bob").mkdir(mode=0o700, exist_ok=True)
    for command in (
        f"ln -s {hidden} {own}/sae-charlie.key",
        f"ln -s {hidden} {keys}/bob/00000000-0000-0000-0000-000000000001",
        f"mv {keys}/bob {keys}/aside",
        f"rm {own}/charlie.sock",
        f"mount -o remount,bind,rw {keys}",
        f"unshare --map-root-user --mount mount -o remount,bind,rw {keys}",
        f"umount {keys}",
    ):
        assert charlie.cmd(f"{command}; echo status=$?").strip()[-1] != "0", command
    assert sorted(path.name for path in (*own.iterdir(), *keys.iterdir())) == [
        "bob",
        "charlie.sock",
    ]
    assert charlie.cmd(f"touch {runtime.written_folder('charlie')}/own; echo $?").strip() == "0"
    connect = f"socket.socket(socket.AF_UNIX).connect({runtime.socket('charlie')!r})"
    output = charlie.cmd(f'{sys.executable} -c "import socket; {connect}; print(42)"')
    assert output.strip() == "42"


def test_a_host_does_not_see_where_programs_of_another_meet(shared_network: Network) -> None:
    """As wireguard-go and wg do in /run/wireguard, and others by shared memory and queues."""
    alice, charlie = (shared_network.host(name) for name in ("alice", "charlie"))
    bound = "socket.socket(socket.AF_UNIX).bind('/run/wireguard/wg0.sock')"
    made = alice.cmd(
        f'mkdir -p /run/wireguard && {sys.executable} -c "import socket; {bound}" && '
        "echo secret > /dev/shm/kept && ipcmk --queue > /dev/null; echo status=$?"
    )
    assert made.strip() == "status=0"
    looks = "ls /run/wireguard /dev/shm; ipcs --queues"
    for seen in (alice.cmd(looks), alice.pexec(["sh", "-c", looks])[0]):
        assert all(word in seen for word in ("wg0.sock", "kept", "0x")), seen
    for seen in (charlie.cmd(looks), charlie.pexec(["sh", "-c", looks])[0]):
        assert not [word for word in ("wg0.sock", "kept", "0x") if word in seen]
    alice.cmd("rm -r /run/wireguard /dev/shm/kept; ipcrm --all=msg")


def test_a_host_has_terminals_of_its_own_and_no_others(shared_network: Network) -> None:
    charlie, alice = shared_network.host("charlie"), shared_network.host("alice")
    terminal = os.ttyname(alice.slave)
    assert Path(terminal).is_char_device()
    for host in (charlie, alice):
        assert host.cmd(f"ls /dev/pts; head -c 1 {terminal}").split()[0] == "ptmx"
        assert "No such file" in host.cmd(f"head -c 1 {terminal}")
        output = host.cmd(f"{sys.executable} -c 'import pty; pty.spawn([\"tty\"])'")
        assert output.strip() == "/dev/pts/0"


def test_root_stays_root_and_tools_work(shared_network: Network) -> None:
    charlie, alice = (shared_network.host(name) for name in ("charlie", "alice"))
    server = charlie.popen(
        [sys.executable, "-m", "http.server", "8000"],
        cwd=ROOT / "docs",
        stdout=DEVNULL,
        stderr=DEVNULL,
    )
    try:
        wait_until(lambda: ":8000" in charlie.cmd("ss -ltn"), "the server listens")
        assert "1 received" in alice.cmd(f"ping -c 1 {charlie.IP()}")
        assert "openflow.md" in alice.cmd(f"curl -s http://{charlie.IP()}:8000/")
        assert str(server.pid) not in charlie.cmd("ps -eo pid=").split()
        assert "http.server" in charlie.cmd("ps -eo args=")
    finally:
        server.terminate()
    assert server.wait(5) == -signal.SIGTERM
    assert charlie.cmd("id -u").strip() == "0"
    file = shared_network.runtime.logs.parent / "one.pcap"
    charlie.cmd(f"tcpdump -U -i charlie-eth0 -c 1 -w {file} icmp 2>/dev/null &")
    wait_until(lambda: file.exists() and file.stat().st_size >= 24, "the capture has begun")
    alice.cmd(f"ping -c 1 {charlie.IP()}")
    wait_until(lambda: file.stat().st_size > 24, "a packet is captured")
    assert charlie.cmd("sysctl -n net.ipv4.ip_forward=1").strip() == "1"
    charlie.cmd("ip link add some type veth peer name other && ip link del some")
    assert charlie.cmd("echo $?").strip() == "0"
