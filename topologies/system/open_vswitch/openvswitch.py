"""Open vSwitch: a run's own in namespaces of its own, else that of this machine."""

import os
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from topologies.system import namespaces
from topologies.system.kernel import interfaces, packet_sockets
from topologies.system.processes.commands import run
from topologies.system.processes.programs import SETUP, NetworkError, Program
from topologies.timeouts import (
    INTERFACE_S,
    OPENVSWITCH_TIMEOUT_S,
    POLL_S,
    STOPPED_DAEMON_S,
    VSCTL_GRACE_S,
    VSCTL_TIMEOUT_S,
)

SCHEMA = Path("/usr/share/openvswitch/vswitch.ovsschema")
DATABASE_FILE = Path("/etc/openvswitch/conf.db")
RUN_FOLDER = Path("/var/run/openvswitch")
SOCKET = RUN_FOLDER / "db.sock"  # of the database
DATABASE, SWITCH_DAEMON = "ovsdb-server", "ovs-vswitchd"
DATAPATH_INTERFACE = "ovs-netdev"  # in user space; it stays when the daemon is killed
CERTIFICATES = [
    "--private-key=db:Open_vSwitch,SSL,private_key",
    "--certificate=db:Open_vSwitch,SSL,certificate",
    "--bootstrap-ca-cert=db:Open_vSwitch,SSL,ca_cert",
]
LOGGING = ["-vsyslog:off", "-vfile:off"]  # what it prints is in the log of the program
# In user space it asks for a piece of memory for each port, and gives it back, whenever anything
# happens: half of its time with a thousand ports, unless the C library keeps them at hand. It keeps
# this number for each of 64 sizes up to 1,032 bytes in each thread, and pieces wander from thread
# to thread: the count bounds what the daemon grows by.
FAST_MEMORY = ["env", "GLIBC_TUNABLES=glibc.malloc.tcache_count=2048"]
NO_WAIT = "--no-wait"  # for the switch daemon: what is only asked for is in the database
NOT_RUNNING = (
    "Open vSwitch does not run on this machine: start it by `sudo service "
    "openvswitch-switch start`, or run the program by `qmn script`, which brings its own"
)

_own: dict[str, Program] = {}  # the daemons of the run's own, by name
_ended = False  # whether these have ended


def start(program: Callable[[str], Program]) -> None:
    """Start the run's own, empty, whose daemons `program` makes; elsewhere require the machine's.

    Raise NetworkError if it does not start.
    """
    if not installed():
        raise NetworkError(f"Open vSwitch is not installed; {SETUP}")
    if not namespaces.are_own():
        if not running():
            raise NetworkError(NOT_RUNNING)
        return
    global _ended
    _ended = False
    _load_module()
    for folder in (RUN_FOLDER, DATABASE_FILE.parent):
        shutil.rmtree(folder.resolve(), ignore_errors=True)  # its content, where it is a mount
        folder.resolve().mkdir(parents=True, exist_ok=True)
    run("ovsdb-tool", "create", str(DATABASE_FILE), str(SCHEMA), timeout_s=OPENVSWITCH_TIMEOUT_S)
    remote = [f"--remote=punix:{SOCKET}", *CERTIFICATES, "--pidfile"]
    _begin(program, DATABASE, [DATABASE, str(DATABASE_FILE), *remote, *LOGGING], SOCKET.exists)
    vsctl("--retry", NO_WAIT, "init")
    command = [*FAST_MEMORY, SWITCH_DAEMON, f"unix:{SOCKET}", "--pidfile", *LOGGING]
    _begin(program, SWITCH_DAEMON, command, (RUN_FOLDER / f"{SWITCH_DAEMON}.pid").exists)


def _load_module() -> None:
    """Load the kernel's module, if this machine has one; containers have none of their own."""
    if _in_container() or shutil.which("modprobe") is None:
        return
    with suppress(NetworkError):  # there is none: switches are in user space
        run("modprobe", "openvswitch", timeout_s=OPENVSWITCH_TIMEOUT_S)


def _begin(
    program: Callable[[str], Program], name: str, command: list[str], is_ready: Callable[[], bool]
) -> None:
    _own[name] = daemon = program(name)
    daemon.start(command)
    deadline = time.monotonic() + OPENVSWITCH_TIMEOUT_S
    while not is_ready():
        if not daemon.running:
            raise NetworkError(f"{name} ended at its start: {daemon.end()}")
        if time.monotonic() > deadline:
            raise NetworkError(f"{name} did not start in {OPENVSWITCH_TIMEOUT_S:g} s")
        time.sleep(POLL_S)


def end() -> None:
    """End the run's own, with all that is in it; bridges and their ports go with it.

    Raise NetworkError if the kernel does not free it in time.
    """
    global _ended
    _ended = bool(_own)
    daemons = [_own.pop(name) for name in (SWITCH_DAEMON, DATABASE) if name in _own]
    limit_s = OPENVSWITCH_TIMEOUT_S + INTERFACE_S * len(interfaces.all_here())
    for daemon in daemons:
        if daemon.running:
            with packet_sockets.held(daemon.pid):
                daemon.kill(limit_s)


def programs() -> list[Program]:
    return [*_own.values()]


def require_alive() -> None:
    """Raise NetworkError if a daemon of the run's own has ended."""
    for daemon in programs():
        if not daemon.running:
            raise NetworkError(f"{daemon.name} died in mid-run: {daemon.end()}")


def switch_daemon_pid() -> int:
    """Return the process id of the switch daemon; raise NetworkError if it does not run."""
    try:
        return int((RUN_FOLDER / f"{SWITCH_DAEMON}.pid").read_text())
    except (OSError, ValueError) as error:
        raise NetworkError(f"{SWITCH_DAEMON} does not run: {error}") from error


def vsctl(*arguments: str) -> str:
    """Run ovs-vsctl; raise NetworkError with its words, or those of a daemon, if it fails."""
    limit_s = VSCTL_TIMEOUT_S + INTERFACE_S * len(interfaces.all_here())
    needed = [DATABASE] if NO_WAIT in arguments else [DATABASE, SWITCH_DAEMON]
    with _naming_a_daemon(needed) as check:
        return run(
            *("ovs-vsctl", f"--timeout={limit_s:.0f}", *arguments),
            timeout_s=limit_s + VSCTL_GRACE_S,
            check=check,
        )


@contextmanager
def _naming_a_daemon(needed: Sequence[str]) -> Iterator[Callable[[], None]]:
    """Give a check to make while one waits for daemons; raise NetworkError for the one at fault."""
    watched = [_own[name] for name in needed if name in _own]
    stopped: dict[str, float] = {}  # since when

    def check() -> None:
        require_alive()
        now = time.monotonic()
        for daemon in watched:
            if not daemon.stopped:
                stopped.pop(daemon.name, None)
            elif now - stopped.setdefault(daemon.name, now) > STOPPED_DAEMON_S:
                raise NetworkError(_silence(daemon))

    try:
        yield check
    except NetworkError as error:
        require_alive()
        if not (namespaces.are_own() or SOCKET.exists()):
            raise NetworkError(NOT_RUNNING) from error
        if silent := next((daemon for daemon in watched if daemon.stopped), None):
            raise NetworkError(_silence(silent)) from error
        raise


def _silence(daemon: Program) -> str:
    remedy = f"let it go on by `kill -CONT {daemon.pid}`"
    return f"{daemon.name} does not answer: a signal has stopped it; {remedy}"


_put_off: list[str] | None = None  # words of changes, within one_transaction


@contextmanager
def one_transaction() -> Iterator[None]:
    """Make all changes together at the end: Open vSwitch goes through all its ports for each."""
    global _put_off
    _put_off = []
    try:
        yield
        commands = _put_off
    finally:
        _put_off = None
    if commands:
        vsctl(*commands)


def change(*arguments: str) -> str:
    """Run ovs-vsctl; in a transaction, when all that it does is known, and without its words."""
    commands = list(arguments[1:] if arguments[:1] == ("--",) else arguments)
    if _put_off is None:
        return vsctl(*commands)
    _put_off.extend(["--", *commands] if _put_off else commands)
    return ""


def installed() -> bool:
    return SCHEMA.exists() and shutil.which("ovs-vsctl") is not None


def running() -> bool:
    try:
        bridges()
    except NetworkError:
        return False
    return True


def bridges() -> list[str]:
    return vsctl(NO_WAIT, "list-br").split()


def add(bridge: str, controller: str) -> None:
    """Make a bridge without ports, for a controller such as "tcp:127.0.0.1:6653"."""
    kind = "netdev" if datapath() == "user" else "system"
    settings = [f"datapath_type={kind}", "protocols=OpenFlow14", "fail_mode=secure"]
    made = ["add-br", bridge, "--", "set", "bridge", bridge, *settings]
    vsctl(*made, "--", "set-controller", bridge, controller)


def apply_settings(bridge: str) -> None:
    """Let the connections to controllers that there are have the settings that we gave them.

    Open vSwitch gives its own to a new one (ofproto/connmgr.c, ofservice_create), and ours to those
    that there are when something else has changed that it reads in its database.
    """
    vsctl(NO_WAIT, "set", "Bridge", bridge, "other_config:qmn-connected=true")


def certify(authority: str, certificate: str, private_key: str) -> None:
    """Show this certificate in TLS: one for all bridges."""
    files = {"private_key": private_key, "certificate": certificate, "ca_cert": authority}
    columns = [f'{name}="{path}"' for name, path in files.items()]
    made = ["--id=@tls", "create", "SSL", *columns]
    vsctl("del-ssl", "--", *made, "--", "set", "Open_vSwitch", ".", "ssl=@tls")


def management(bridge: str) -> Path:
    return RUN_FOLDER / f"{bridge}.mgmt"


def require_made(bridges: Iterable[str]) -> None:
    """Raise NetworkError if a bridge that was asked for is not there."""
    missing = [name for name in bridges if not management(name).exists()]
    if not missing:
        return
    name, tun = missing[0], Path(interfaces.TUN)
    if not tun.exists():
        text = f"Open vSwitch cannot make {name} without {tun}"
        raise NetworkError(f"{text}: in a container, give it --device={tun}")
    why = vsctl(NO_WAIT, "--bare", "--columns=error", "find", "Interface", f"name={name}").strip()
    raise NetworkError(
        f"Open vSwitch did not make {name}: {why or f'the log of {SWITCH_DAEMON} says why'}"
    )


def delete(*names: str) -> None:
    """Delete bridges, those that are there; with the run's own daemons they have gone."""
    if not names or _ended:
        return
    for name in names:
        remove_agent_sockets(name)
    vsctl(*[word for name in names for word in ("--", "--if-exists", "del-br", name)][1:])


def agent_socket(bridge: str) -> Path:
    """Return where the agent of a quantum switch listens: one socket a controller, numbered."""
    return RUN_FOLDER / f"{bridge}.agent"


def remove_agent_sockets(bridge: str) -> None:
    for left in RUN_FOLDER.glob(f"{bridge}.agent[0-9]*"):
        left.unlink(missing_ok=True)


def datapath() -> str:
    """Return "kernel" where Open vSwitch's kernel module is loaded, else "user".

    A container sees the module of the machine it is on, which is not its own to use.
    """
    loaded = Path("/sys/module/openvswitch").exists()
    return "kernel" if loaded and not _in_container() else "user"


def _in_container() -> bool:
    return os.environ.get("QMN_MODE") == "docker"
