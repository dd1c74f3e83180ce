"""Checks of this machine: what a network needs of it, what is missing, what to do about it.

Kernel features are tried in a network namespace of their own, which ends with the attempt.
"""

import os
import re
import resource
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec

from qmn.project import project
from qmn.timeouts import TRY_TIMEOUT_S
from topologies.networks.requirements import LEAST_FILES
from topologies.system import namespaces
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.programs import ROOT, SETUP, NetworkError

WORKS, LIMITED, FAILS, UNCHECKED = "works", "limited", "fails", "unchecked"
PIP = SETUP if (ROOT / "Makefile").exists() else "install the package qmn again"
SUDO = "run it with sudo"


@dataclass(frozen=True)
class Finding:
    """One check: what was found, and what to do unless it works."""

    name: str
    state: str  # one of the four above
    found: str
    remedy: str = ""


def check_machine() -> Iterator[Finding]:
    yield user()
    yield open_files()
    yield from kernel()
    yield packages()
    yield python_packages()
    yield open_vswitch()
    yield docker()
    yield running_networks()


def user() -> Finding:
    """The user: namespaces and bridges are root's."""
    if os.geteuid() == 0:
        return Finding("user", WORKS, "root")
    remedy = (
        "`sudo qmn doctor` or `qmn rootless doctor` checks more; verbs that need root ask for it "
        "by sudo"
    )
    return Finding("user", LIMITED, f"not root but user {os.geteuid()}", remedy)


def open_files() -> Finding:
    _soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    unlimited = hard == resource.RLIM_INFINITY
    if unlimited or hard >= LEAST_FILES:
        return Finding("open files", WORKS, "no limit" if unlimited else f"up to {hard:,}")
    remedy = f"raise the hard limit: ulimit -Hn {LEAST_FILES}"
    return Finding(
        "open files", FAILS, f"at most {hard:,}; a network needs {LEAST_FILES:,}", remedy
    )


def kernel() -> Iterator[Finding]:
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
    status, output = _run("unshare", "--net", *command)
    if status == 0:
        return Finding(name, WORKS, "tried")
    return Finding(name, without, output or f"status {status}", remedy)


def packages() -> Finding:
    names = (ROOT / "apt-packages.txt").read_text().split()
    if shutil.which("dpkg-query") is None:
        return Finding("packages", LIMITED, "no Debian-like system", "use MODE=docker")
    form = "${db:Status-Status} ${Package}\n"
    _status, output = _run("dpkg-query", "-W", "-f", form, *names)
    installed = {line.split()[1] for line in output.splitlines() if line.startswith("installed ")}
    missing = sorted(set(names) - installed)
    if missing:
        return Finding("packages", FAILS, f"missing: {', '.join(missing)}", SETUP)
    return Finding("packages", WORKS, f"{len(names)} of apt-packages.txt are installed")


def python_packages() -> Finding:
    """Packages of the programs: Mininet, of Debian, and what pyproject.toml lists."""
    needed = [each for each in project()["dependencies"] if ";" not in each]
    names = [re.split(r"[^\w.-]", requirement)[0] for requirement in needed]
    missing = [] if find_spec("mininet") else ["mininet"]
    missing += [name for name in names if not _installed(name)]
    if missing:
        return Finding("Python packages", FAILS, f"missing: {', '.join(missing)}", PIP)
    text = f"mininet and {len(names)} of pyproject.toml are installed"
    return Finding("Python packages", WORKS, text)


def _installed(distribution: str) -> bool:
    try:
        metadata.distribution(distribution)
    except metadata.PackageNotFoundError:
        return False
    return True


def open_vswitch() -> Finding:
    name = "Open vSwitch"
    if not openvswitch.installed():
        return Finding(name, FAILS, "not installed", SETUP)
    if os.geteuid() != 0:
        return Finding(name, UNCHECKED, "installed", SUDO)
    state = "installed, each run starts its own"
    if openvswitch.datapath() == "kernel":
        return Finding(name, WORKS, f"{state}; switches in the kernel")
    remedy = "nothing need be done; switches are faster with the kernel module openvswitch"
    return Finding(name, LIMITED, f"{state}; switches in user space, no kernel module", remedy)


def docker() -> Finding:
    if os.environ.get("QMN_MODE") == "docker":
        return Finding("Docker", WORKS, "this is a container")
    status, output = _run(str(ROOT / "docker" / "engine"))
    if status == 0:
        return Finding("Docker", WORKS, output)
    return Finding("Docker", LIMITED, output, "start or install an engine, or use MODE=native")


def running_networks() -> Finding:
    """Whether networks run: there can be several, each in namespaces of its own."""
    name = "running networks"
    try:
        networks = namespaces.running()
    except NetworkError as error:
        return Finding(name, UNCHECKED, str(error), SUDO)
    return Finding(name, WORKS, ", ".join(map(str, networks)) or "none")


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
