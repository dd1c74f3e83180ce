"""Open vSwitch on this machine: is it running, which datapath has it, who started it."""

import os
import shutil
import subprocess
import time
from pathlib import Path

from topologies.programs import NetworkError
from topologies.runtime import alive

CONTROL = "/usr/share/openvswitch/scripts/ovs-ctl"
RUN_FOLDER = Path("/var/run/openvswitch")
START_TIMEOUT_S = 30.0
OWNER = "external_ids:qmn"  # which run has made a bridge, or started Open vSwitch


def vsctl(*arguments: str) -> str:
    """Run ovs-vsctl; raise NetworkError with its words if it fails."""
    return _run("ovs-vsctl", "--timeout=10", *arguments)


def installed() -> bool:
    """Whether it is on this machine."""
    return Path(CONTROL).exists() and shutil.which("ovs-vsctl") is not None


def running() -> bool:
    """Whether both daemons answer."""
    probe = ["ovs-vsctl", "--timeout=2", "--no-wait", "show"]
    try:
        database = subprocess.run(probe, capture_output=True, check=False)
    except FileNotFoundError as error:
        raise NetworkError("Open vSwitch is not installed; run `make setup`") from error
    return database.returncode == 0 and _switch_daemon_runs()


def start(owner: str) -> None:
    """Start Open vSwitch and note that this run started it."""
    if not Path(CONTROL).exists():
        raise NetworkError("Open vSwitch is not installed; run `make setup`")
    _run(CONTROL, "start", "--system-id=random", timeout_s=START_TIMEOUT_S)
    deadline = time.monotonic() + START_TIMEOUT_S
    while not running():
        if time.monotonic() > deadline:
            raise NetworkError(f"Open vSwitch did not start in {START_TIMEOUT_S:g} s")
        time.sleep(0.05)
    vsctl("set", "Open_vSwitch", ".", f"{OWNER}={owner}")


def adopt(owner: str) -> None:
    """Take over an Open vSwitch that a run of ours has started and could not stop."""
    first = starter()
    if first.isdigit() and not alive(first):
        vsctl("set", "Open_vSwitch", ".", f"{OWNER}={owner}")


def stop_if_ours(owner: str) -> None:
    """Stop Open vSwitch if this run started it and no bridge is left in it."""
    if running() and starter() == owner and not bridges():
        vsctl("remove", "Open_vSwitch", ".", "external_ids", "qmn")
        _run(CONTROL, "stop", timeout_s=START_TIMEOUT_S)


def starter() -> str:
    """Return which run has started Open vSwitch, "" if none of ours did."""
    return vsctl("--if-exists", "get", "Open_vSwitch", ".", OWNER).strip('"\n ')


def bridges() -> list[str]:
    """Return the names of all bridges, ours or not."""
    return vsctl("list-br").split()


def owner_of(bridge: str) -> str:
    """Return the run that made a bridge, "" if none of ours did."""
    return vsctl("--if-exists", "get", "Bridge", bridge, OWNER).strip('"\n ')


def add(bridge: str, owner: str, controller: str) -> None:
    """Make a bridge of ours without ports, for a controller such as "tcp:127.0.0.1:6653"."""
    kind = "netdev" if datapath() == "user" else "system"
    settings = [f"datapath_type={kind}", "protocols=OpenFlow14", "fail_mode=secure"]
    made = ["add-br", bridge, "--", "set", "bridge", bridge, *settings, f"{OWNER}={owner}"]
    vsctl(*made, "--", "set-controller", bridge, controller)


def delete(bridge: str) -> None:
    """Delete a bridge of ours, if it is there."""
    vsctl("--if-exists", "del-br", bridge)


def delete_interface(name: str) -> None:
    """Delete an interface of ours, if it is still there: its peer takes it along."""
    if Path("/sys/class/net", name).exists():
        _run("ip", "link", "delete", name)


def datapath() -> str:
    """Return "kernel" where Open vSwitch's kernel module is loaded, else "user".

    Starting Open vSwitch loads the module if the machine has one. A container sees the
    module of the machine it is on, which is not its own to use.
    """
    in_container = os.environ.get("QMN_MODE") == "docker"
    loaded = Path("/sys/module/openvswitch").exists()
    return "kernel" if loaded and not in_container else "user"


def _switch_daemon_runs() -> bool:
    pid_file = RUN_FOLDER / "ovs-vswitchd.pid"
    try:
        return Path(f"/proc/{int(pid_file.read_text())}").exists()
    except (OSError, ValueError):
        return False


def _run(*command: str, timeout_s: float = 15.0) -> str:
    try:
        # In a session of its own: a Ctrl-C must not leave half of what it does undone.
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            check=False,
            timeout=timeout_s,
            start_new_session=True,
        )
    except FileNotFoundError as error:
        raise NetworkError(f"{command[0]} is not installed; run `make setup`") from error
    except subprocess.TimeoutExpired as error:
        raise NetworkError(f"{command[0]} did not end in {timeout_s:g} s") from error
    if done.returncode:
        words = (done.stderr or done.stdout).strip()
        raise NetworkError(f"{' '.join(command[:3])} failed: {words}")
    return done.stdout
