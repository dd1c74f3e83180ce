"""Checks of this machine: what a network needs of it, what is missing, what to do about it.

Kernel features are tried in a network namespace of their own, which ends with the attempt.
"""

import os
import re
import resource
import shutil
import socket
import subprocess
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from qmn.live.running import dispatcher_of_running_network
from qmn.timeouts import TRY_TIMEOUT_S
from topologies.networks import leftovers
from topologies.networks.network import LEAST_FILES, interfaces_of
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.programs import ROOT, NetworkError
from topologies.system.runs.runtime import RUNTIME_ROOT
from wire.parameters.network import OPENFLOW_PORT

WORKS, LIMITED, FAILS, UNCHECKED = "works", "limited", "fails", "unchecked"
NAMES_OF_DEMO = ("s1", "q1")
SETUP = "run `make setup`"
SUDO = "run it with sudo"


@dataclass(frozen=True)
class Finding:
    """One check: what was found, and what to do unless it works."""

    name: str
    state: str  # one of the four above
    found: str
    remedy: str = ""


def check_machine() -> Iterator[Finding]:
    """Yield all findings."""
    yield user()
    yield open_files()
    yield from kernel()
    yield packages()
    yield python_packages()
    yield open_vswitch()
    yield docker()
    yield running_network()
    yield controller_port()
    yield names()
    yield left()


def user() -> Finding:
    """Who asks: namespaces and bridges are root's."""
    if os.geteuid() == 0:
        return Finding("user", WORKS, "root")
    remedy = "`sudo qmn doctor` checks more; verbs that need root ask for it by themselves"
    return Finding("user", LIMITED, f"not root but user {os.geteuid()}", remedy)


def open_files() -> Finding:
    """How many files a program may open."""
    _soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    unlimited = hard == resource.RLIM_INFINITY
    if unlimited or hard >= LEAST_FILES:
        return Finding("open files", WORKS, "no limit" if unlimited else f"up to {hard:,}")
    remedy = f"raise the hard limit: ulimit -Hn {LEAST_FILES}"
    return Finding(
        "open files", FAILS, f"at most {hard:,}; a network needs {LEAST_FILES:,}", remedy
    )


def kernel() -> Iterator[Finding]:
    """What the kernel must be able to do."""
    module = "load the kernel module {0} (modprobe {0}), or use a kernel that has it"
    tries = (
        ("network namespaces", FAILS, ["true"], "allow them: in a container CAP_SYS_ADMIN"),
        (
            "veth (links, fibres)",
            FAILS,
            ["ip", "link", "add", "v0", "type", "veth", "peer", "name", "v1"],
            module.format("veth"),
        ),
        (
            "TUN (userspace switches)",
            FAILS,
            ["ip", "tuntap", "add", "dev", "t0", "mode", "tap"],
            module.format("tun") + "; in a container --device=/dev/net/tun",
        ),
        (
            "htb (bw= of copper links)",
            LIMITED,
            ["tc", "qdisc", "add", "dev", "lo", "root", "htb"],
            module.format("sch_htb"),
        ),
        (
            "netem (delay=, loss= of copper links)",
            LIMITED,
            ["tc", "qdisc", "add", "dev", "lo", "root", "netem", "delay", "1ms"],
            module.format("sch_netem") + "; fibres do not need it",
        ),
    )
    for name, without, command, remedy in tries:
        yield _tried(name, without, command, remedy)


def _tried(name: str, without: str, command: list[str], remedy: str) -> Finding:
    if os.geteuid() != 0:
        return Finding(name, UNCHECKED, "only root can try it", SUDO)
    if shutil.which(command[0]) is None:
        return Finding(name, FAILS, f"{command[0]} is not installed", SETUP)
    status, words = _run("unshare", "--net", *command)
    if status == 0:
        return Finding(name, WORKS, "tried")
    return Finding(name, without, words or f"status {status}", remedy)


def packages() -> Finding:
    """The Debian packages that set-up installs."""
    wanted = (ROOT / "apt-packages.txt").read_text().split()
    if shutil.which("dpkg-query") is None:
        return Finding("packages", LIMITED, "no Debian-like system", "use MODE=docker")
    form = "${db:Status-Status} ${Package}\n"
    _status, words = _run("dpkg-query", "-W", "-f", form, *wanted)
    installed = {line.split()[1] for line in words.splitlines() if line.startswith("installed ")}
    missing = sorted(set(wanted) - installed)
    if missing:
        return Finding("packages", FAILS, f"missing: {', '.join(missing)}", SETUP)
    return Finding("packages", WORKS, f"{len(wanted)} of apt-packages.txt are installed")


def python_packages() -> Finding:
    """What the programs import: Mininet, of Debian, and what pyproject.toml lists."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [re.split(r"[^\w.-]", each)[0] for each in project["dependencies"]]
    missing = [] if find_spec("mininet") else ["mininet"]
    missing += [name for name in wanted if not _installed(name)]
    if missing:
        return Finding("Python packages", FAILS, f"missing: {', '.join(missing)}", SETUP)
    found = f"mininet and {len(wanted)} of pyproject.toml are installed"
    return Finding("Python packages", WORKS, found)


def _installed(distribution: str) -> bool:
    try:
        metadata.distribution(distribution)
    except metadata.PackageNotFoundError:
        return False
    return True


def open_vswitch() -> Finding:
    """The switches."""
    name = "Open vSwitch"
    if not openvswitch.installed():
        return Finding(name, FAILS, "not installed", SETUP)
    if os.geteuid() != 0:
        return Finding(name, UNCHECKED, "installed", SUDO)
    state = "running" if openvswitch.running() else "installed, a run starts and stops it"
    if openvswitch.datapath() == "kernel":
        return Finding(name, WORKS, f"{state}; switches in the kernel")
    remedy = "nothing need be done; switches are faster with the kernel module openvswitch"
    return Finding(name, LIMITED, f"{state}; switches in user space, no kernel module", remedy)


def docker() -> Finding:
    """The engine, for those who would rather have it all in a container."""
    if os.environ.get("QMN_MODE") == "docker":
        return Finding("Docker", WORKS, "this is a container")
    status, words = _run(str(ROOT / "docker" / "engine"))
    if status == 0:
        return Finding("Docker", WORKS, words)
    return Finding("Docker", LIMITED, words, "start or install an engine, or use MODE=native")


def running_network() -> Finding:
    """Whether a network runs: there can be one."""
    name = "running network"
    try:
        config = dispatcher_of_running_network()
    except NetworkError as error:
        if "no network runs" in str(error):
            return Finding(name, WORKS, "none: one can start")
        return Finding(name, LIMITED, str(error), "wait, or end it; there can be one at a time")
    place = Path(config.event_capture or config.socket).parent  # its events are not always written
    return Finding(name, LIMITED, f"one runs, see {place}", "end it before you start another")


def controller_port() -> Finding:
    """The controller's TCP port."""
    name = f"port {OPENFLOW_PORT} (controller)"
    try:
        with socket.create_server(("127.0.0.1", OPENFLOW_PORT)):
            return Finding(name, WORKS, "free")
    except OSError as error:
        remedy = "end what listens there (`ss -ltnp`), or `qmn run --openflow-port PORT`"
        return Finding(name, LIMITED, str(error.strerror), remedy)


def names() -> Finding:
    """Names that a run needs and somebody else has."""
    name = f"names {', '.join(NAMES_OF_DEMO)}"
    foreign: list[str] = []
    ours: set[str] = set()
    try:
        if openvswitch.installed() and os.geteuid() == 0 and openvswitch.running():
            bridges = set(openvswitch.bridges()) & set(NAMES_OF_DEMO)
            ours = {bridge for bridge in bridges if openvswitch.owner_of(bridge)}
            foreign += [f"bridge {bridge}" for bridge in sorted(bridges - ours)]
        if not ours and not leftovers.find().interfaces:
            taken = [found for wanted in NAMES_OF_DEMO for found in interfaces_of(wanted)]
            foreign += [f"interface {found}" for found in taken]
    except (NetworkError, PermissionError) as error:
        return Finding(name, UNCHECKED, str(error), SUDO)
    if foreign:
        remedy = "rename or remove what is not ours: `ovs-vsctl del-br`, `ip link del`"
        return Finding(name, FAILS, f"taken: {', '.join(foreign)}", remedy)
    return Finding(name, WORKS, "free, or ours")


def left() -> Finding:
    """What killed runs have left."""
    name = "leftovers of earlier runs"
    if os.geteuid() != 0:
        return Finding(name, UNCHECKED, f"only root can look into {RUNTIME_ROOT}", SUDO)
    try:
        found = leftovers.find().lines()
    except NetworkError as error:
        return Finding(name, UNCHECKED, str(error), "see Open vSwitch above")
    if found:
        return Finding(
            name, LIMITED, "; ".join(found), "run `qmn clean`; the next run does so, too"
        )
    return Finding(name, WORKS, "none")


def _run(*command: str) -> tuple[int, str]:
    """Return status and words of a command; 127 if it is not there, 124 if it hangs."""
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=TRY_TIMEOUT_S
        )
    except FileNotFoundError:
        return 127, f"{command[0]} is not installed"
    except subprocess.TimeoutExpired:
        return 124, f"{command[0]} did not end in {TRY_TIMEOUT_S:g} s"
    return done.returncode, (done.stdout.strip() or done.stderr.strip())
