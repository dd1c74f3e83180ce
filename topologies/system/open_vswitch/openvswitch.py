"""Open vSwitch on this machine: is it running, which datapath has it, who started it."""

import os
import re
import shutil
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from topologies.system.kernel import interfaces, packet_sockets
from topologies.system.open_vswitch import database
from topologies.system.open_vswitch.database import UNREACHABLE
from topologies.system.processes import owners
from topologies.system.processes.commands import run
from topologies.system.processes.owners import RUNTIME_ROOT, Owner
from topologies.system.processes.programs import NetworkError, callers_environment
from topologies.timeouts import (
    DATABASE_ANSWER_S,
    INTERFACE_S,
    LAST_WORDS_TIMEOUT_S,
    OPENVSWITCH_COMMAND_TIMEOUT_S,
    OPENVSWITCH_TIMEOUT_S,
    POLL_S,
    STOPPED_DAEMON_S,
    VSCTL_GRACE_S,
    VSCTL_TIMEOUT_S,
)

CONTROL = "/usr/share/openvswitch/scripts/ovs-ctl"
RUN_FOLDER = Path("/var/run/openvswitch")
SOCKET = "db.sock"  # of the database, in there
LOG_FOLDER = Path("/var/log/openvswitch")
DATABASE, SWITCH_DAEMON = "ovsdb-server", "ovs-vswitchd"
DAEMONS = (DATABASE, SWITCH_DAEMON)
DATAPATH_INTERFACE = "ovs-netdev"  # in user space; the daemon deletes it with the last bridge
STARTED = "open-vswitch"  # file: the run that has started the daemons, then the daemons
STARTER = "QMN_STARTED_OPEN_VSWITCH"  # in the environment of daemons: the run that started them
# In user space it asks for a piece of memory for each port, and gives it back, whenever anything
# happens: half of its time with a thousand ports, unless the C library keeps them at hand. It keeps
# so many for each of 64 sizes up to 1,032 bytes in each thread, and pieces wander from thread to
# thread: the count bounds what the daemon grows by.
FAST_MEMORY = {"GLIBC_TUNABLES": "glibc.malloc.tcache_count=2048"}
NO_WAIT = "--no-wait"  # for the switch daemon: what is only asked for is in the database
OWNER_KEY = "qmn"
OWNER = f"external_ids:{OWNER_KEY}"  # which run has made a bridge
TRIES = 3  # where its database ends while it is to be stopped, or started for that
RESTART = "restart Open vSwitch, as by `systemctl restart openvswitch-switch`"


def vsctl(*arguments: str) -> str:
    """Run ovs-vsctl; raise NetworkError with its words, or those of a daemon, if it fails."""
    with _waited_for(*arguments) as (limit_s, check):
        return run(
            *("ovs-vsctl", f"--timeout={limit_s:.0f}", *arguments),
            timeout_s=limit_s + VSCTL_GRACE_S,
            check=check,
        )


def _selected(table: str, *columns: str) -> list[dict[str, Any]]:
    """Return rows of the database; raise NetworkError as vsctl does."""
    with _waited_for(NO_WAIT) as (limit_s, check):
        return database.select(RUN_FOLDER / SOCKET, table, [*columns], limit_s, check)


@contextmanager
def _waited_for(*arguments: str) -> Iterator[tuple[float, Callable[[], None]]]:
    """Give how long to wait for what ovs-vsctl does for these arguments, and a check meanwhile.

    If that fails, raise NetworkError with the words of a daemon that is the reason.
    """
    limit_s = VSCTL_TIMEOUT_S + INTERFACE_S * len(interfaces.all_here())
    # The switch daemon may end beside a command that does not need it.
    needed = (DATABASE,) if NO_WAIT in arguments else DAEMONS
    watched = {name: daemon for name, daemon in daemons().items() if name in needed}
    stopped: dict[str, float] = {}  # since when

    def check() -> None:
        _require_useful(watched, arguments)
        now = time.monotonic()
        for name, daemon in watched.items():
            if not daemon.stopped:
                stopped.pop(name, None)
            elif now - stopped.setdefault(name, now) > STOPPED_DAEMON_S:
                raise NetworkError(f"{name} {_silence(watched, name)}")

    try:
        yield limit_s, check
    except NetworkError as error:
        require_alive(watched)
        found = daemons()
        if found and (silent := [name for name in needed if not _answers(found, name)]):
            raise NetworkError(f"{silent[0]} {_silence(found, silent[0])}") from error
        if UNREACHABLE in str(error):  # it is ending, and its socket has gone first
            raise NetworkError(f"{DATABASE} does not answer: {error}") from error
        raise


_ours_are_to_end = False  # this run takes down what it has started, whatever stops that


def _require_useful(watched: Mapping[str, Owner], arguments: Sequence[str]) -> None:
    """Raise NetworkError if ovs-vsctl waits for a daemon that has ended, now or before."""
    if _ours_are_to_end:
        _let_go_on()
    require_alive(watched)
    if DATABASE in watched and SWITCH_DAEMON not in watched and NO_WAIT not in arguments:
        raise NetworkError(f"{SWITCH_DAEMON} {_silence(watched, SWITCH_DAEMON)}")


_put_off: list[str] | None = None  # words of changes, within one_transaction


@contextmanager
def one_transaction() -> Iterator[None]:
    """Make all changes together at the end: Open vSwitch goes through all its ports for each."""
    global _put_off
    _put_off = []
    try:
        yield
        words = _put_off
    finally:
        _put_off = None
    if words:
        vsctl(*words)


def change(*arguments: str) -> str:
    """Run ovs-vsctl; in a transaction, when all that it does is known, and without its words."""
    words = list(arguments[1:] if arguments[:1] == ("--",) else arguments)
    if _put_off is None:
        return vsctl(*words)
    _put_off.extend(["--", *words] if _put_off else words)
    return ""


def _answers(found: Mapping[str, Owner], name: str) -> bool:
    return name in found and not found[name].stopped


def _silence(found: Mapping[str, Owner], name: str) -> str:
    """Return why a daemon does not answer, and what to do."""
    if name not in found:
        return f"does not run: {RESTART}"
    pid = found[name].pid
    return f"does not answer: a signal has stopped it; let it go on by `kill -CONT {pid}`"


def installed() -> bool:
    """Whether it is on this machine."""
    return Path(CONTROL).exists() and shutil.which("ovs-vsctl") is not None


def running() -> bool:
    """Whether the database answers and the switch daemon is there."""
    return _database_answers() and SWITCH_DAEMON in daemons()


def _database_answers() -> bool:
    if shutil.which("ovs-vsctl") is None:
        raise NetworkError("Open vSwitch is not installed; run `make setup`")
    try:
        database.ask(RUN_FOLDER / SOCKET, "echo", [], DATABASE_ANSWER_S)
    except NetworkError:
        return False
    return True


def daemons() -> dict[str, Owner]:
    """Return the daemons that run."""
    return {name: found for name in DAEMONS if (found := _daemon(name)) is not None}


def _daemon(name: str) -> Owner | None:
    try:
        pid = int((RUN_FOLDER / f"{name}.pid").read_text())
        named = Path("/proc", str(pid), "comm").read_text().strip()
    except (OSError, ValueError):
        return None
    found = owners.owner(pid)
    return found if named == name and found is not None and found.alive else None


def require_alive(watched: Mapping[str, Owner]) -> None:
    """Raise NetworkError if one of these daemons has ended."""
    for name, daemon in watched.items():
        if not daemon.alive:
            raise NetworkError(
                f"{name} died in mid-run: Open vSwitch's daemon {_end_of(name, daemon)}"
            )


def _end_of(name: str, daemon: Owner) -> str:
    """Return how a daemon has ended, in the words of the process that watches over it."""
    died = re.compile(rf"pid {daemon.pid} died, (.*)")
    log, deadline = LOG_FOLDER / f"{name}.log", time.monotonic() + LAST_WORDS_TIMEOUT_S
    while time.monotonic() < deadline:
        told = died.findall(log.read_text(errors="replace")) if log.exists() else []
        if told:
            return f"was {told[-1].removesuffix(', exiting')}"
        time.sleep(POLL_S)
    return f"(process {daemon.pid}) is gone; its log: {log}"


def start(owner: str) -> None:
    """Start Open vSwitch, or what is missing of ours, and note that this run started it.

    Raise NetworkError where half of it runs that is not ours.
    """
    if not Path(CONTROL).exists():
        raise NetworkError("Open vSwitch is not installed; run `make setup`")
    _let_go_on_or_refuse(owner)
    deadline = time.monotonic() + OPENVSWITCH_TIMEOUT_S
    # ovs-ctl takes a daemon that is just ending for one that runs, and stands in the way of a
    # monitor that starts one again.
    while not running():
        if time.monotonic() > deadline:
            raise NetworkError(f"Open vSwitch did not start in {OPENVSWITCH_TIMEOUT_S:g} s")
        missing = set(DAEMONS) - set(daemons())
        if missing & _watched_over():
            time.sleep(POLL_S)
            continue
        _let_go_on_or_refuse(owner)  # the monitor may have been somebody else's
        _note_starter(owner)  # what crashes at once, and comes back, is this run's to stop
        _start_missing(owner)
    _note_starter(owner)


def _let_go_on_or_refuse(owner: str) -> None:
    """Let daemons of ours go on; raise NetworkError where half of it runs that is not ours."""
    first = starter()
    if first and (first == owner or owners.gone(first)):
        _let_go_on()
    else:
        _refuse_half(daemons())


def _start_missing(owner: str) -> None:
    """Start the daemons that do not run; raise NetworkError if one ends, or does not answer."""
    seen: dict[str, Owner] = {}

    def check() -> None:
        _refuse_stopped()
        seen.update(daemons())
        _refuse_ended(seen)

    try:
        run(
            *(CONTROL, "start", "--system-id=random"),
            timeout_s=OPENVSWITCH_TIMEOUT_S,
            check=check,
            look_s=POLL_S,  # a daemon may end soon after its start
            environment={**callers_environment(), **FAST_MEMORY, STARTER: owner},
        )
    except NetworkError as error:
        _refuse_ended(seen)
        if DATABASE not in daemons() or UNREACHABLE in str(error):  # it has ended unseen
            raise NetworkError(f"{DATABASE} does not answer: {error}") from error
        if SWITCH_DAEMON not in daemons():  # so has this one: ovs-ctl has but harmless warnings
            log = LOG_FOLDER / f"{SWITCH_DAEMON}.log"
            raise NetworkError(f"{SWITCH_DAEMON} ended at its start; its log: {log}") from error
        raise


def _refuse_ended(seen: Mapping[str, Owner]) -> None:
    """Raise NetworkError if a daemon has ended and nobody starts it again."""
    ended = {name: daemon for name, daemon in seen.items() if not daemon.alive}
    if ended.keys() - daemons().keys() - (_watched_over() if ended else set()):
        require_alive(ended)


def _watched_over() -> set[str]:
    """Return the daemons whose monitors run, which start again what has crashed.

    Those of other containers and the like have other files, and are another Open vSwitch.
    """
    found, ours = set(), os.readlink("/proc/self/ns/mnt")
    for process in Path("/proc").glob("[0-9]*"):
        try:
            command = (process / "cmdline").read_bytes().decode(errors="replace")
            name, _, words = command.partition(": ")
            if words.startswith("monitoring") and os.readlink(process / "ns/mnt") == ours:
                found.add(name)
        except OSError:
            continue  # it has ended
    return found


def _refuse_half(found: Mapping[str, Owner]) -> None:
    silent = [name for name in DAEMONS if not _answers(found, name)]
    if found and silent:
        raise NetworkError(f"Open vSwitch runs in part: {silent[0]} {_silence(found, silent[0])}")


def _refuse_stopped() -> None:
    """Raise NetworkError if a signal has stopped a daemon: ovs-ctl would wait for it."""
    found = daemons()
    for name, daemon in found.items():
        if daemon.stopped:
            raise NetworkError(f"{name} {_silence(found, name)}")


def _note_starter(owner: str) -> None:
    RUNTIME_ROOT.mkdir(mode=0o755, parents=True, exist_ok=True)
    lines = [owner, *map(str, daemons().values())]
    (RUNTIME_ROOT / STARTED).write_text("\n".join(lines))


def adopt(owner: str) -> None:
    """Take over an Open vSwitch that a run of ours has started and could not stop."""
    if owners.gone(starter()):
        _note_starter(owner)


def revive_if_ours(owner: str) -> None:
    """Start again what has ended of an Open vSwitch that this run started.

    A bridge whose daemon has ended leaves its interface behind, and only the daemon that comes
    next can remove it in every kind of datapath. From now on they go on whatever stops them.
    """
    global _ours_are_to_end
    if starter() != owner:
        return
    _ours_are_to_end = True
    _let_go_on()
    for tries_left in reversed(range(TRIES)):
        try:
            if not running():
                start(owner)
            return
        except (
            NetworkError
        ):  # ovs-ctl has met one that its monitor was just starting, or that ended
            if not tries_left:
                raise


def stop_if_ours(owner: str) -> None:
    """Stop Open vSwitch if this run started it and no bridge is left in it.

    Where its database ends meanwhile, it is started again, so that all can be stopped in order.
    """
    global _ours_are_to_end
    if starter() != owner:
        return
    if not _noted()[1:] and not daemons() and not _watched_over():  # none has ever come
        (RUNTIME_ROOT / STARTED).unlink(missing_ok=True)
        return
    _let_go_on()
    try:
        if not _database_answers():
            revive_if_ours(owner)
        for tries_left in reversed(range(TRIES)):
            database = daemons().get(DATABASE)
            try:
                _stop(owner)
                return
            except NetworkError:
                # Where it has ended, its monitor may have started it again by now.
                if not tries_left or (database is not None and database.alive):
                    raise
                revive_if_ours(owner)
    finally:
        _ours_are_to_end = False


def _stop(owner: str) -> None:
    if bridges():
        revive_if_ours(owner)
    if bridges():  # of ours, if a daemon ended just as they were to be deleted
        delete(*(name for name, run in runs_of_bridges().items() if run == owner))
    if bridges():
        return
    run(CONTROL, "stop", timeout_s=OPENVSWITCH_TIMEOUT_S, check=_let_go_on)
    interfaces.delete(DATAPATH_INTERFACE)
    (RUNTIME_ROOT / STARTED).unlink(missing_ok=True)  # last: a second signal may come between


def _let_go_on() -> None:
    """Let the daemons go on if a signal has stopped them."""
    for daemon in daemons().values():
        daemon.signal(signal.SIGCONT)


def starter() -> str:
    """Return which run has started the daemons that run, "" if none of ours did.

    They carry its mark, also when their monitors have started them again; a note says who has taken
    them over since that run is gone. Where both have ended, the run that has noted it last: it can
    start them again.
    """
    found = daemons().values()
    noted, *named = _noted()
    if not found:
        return noted
    marked = next((words for daemon in found if (words := _mark_of(daemon))), "")
    taken_over = owners.gone(marked) and set(map(str, found)) & set(named)
    return noted if taken_over else marked


def _noted() -> list[str]:
    """Return which run has noted that it starts the daemons, "" if none, and those that came."""
    try:
        return (RUNTIME_ROOT / STARTED).read_text().splitlines() or [""]
    except OSError:
        return [""]


def _mark_of(daemon: Owner) -> str:
    """Return the run that a daemon carries in its environment, "" if none."""
    mark = f"{STARTER}=".encode()
    try:
        environment = Path("/proc", str(daemon.pid), "environ").read_bytes().split(b"\0")
    except OSError:
        return ""  # it has ended
    marks = [entry.removeprefix(mark).decode() for entry in environment if entry.startswith(mark)]
    return marks[0] if marks else ""


def bridges() -> list[str]:
    """Return the names of all bridges, ours or not."""
    return [*runs_of_bridges()]


def owner_of(bridge: str) -> str:
    """Return the run that made a bridge, "" if none of ours did."""
    return runs_of_bridges().get(bridge, "")


def runs_of_bridges() -> dict[str, str]:
    """Return the run that made each bridge, by one question; "" for what none of ours made."""
    rows = _selected("Bridge", "name", "external_ids")
    return {row["name"]: _owner_in(row) for row in rows}


def _owner_in(row: Mapping[str, Any]) -> str:
    """Return which run has made what a row of the database is about, "" if none of ours did."""
    _map, pairs = row["external_ids"]
    return str(dict(pairs).get(OWNER_KEY, ""))


def add(bridge: str, owner: str, controller: str) -> None:
    """Make a bridge of ours without ports, for a controller such as "tcp:127.0.0.1:6653"."""
    kind = "netdev" if datapath() == "user" else "system"
    settings = [f"datapath_type={kind}", "protocols=OpenFlow14", "fail_mode=secure"]
    made = ["add-br", bridge, "--", "set", "bridge", bridge, *settings, f"{OWNER}={owner}"]
    vsctl(*made, "--", "set-controller", bridge, controller)


def apply_settings(bridge: str) -> None:
    """Let the connections to controllers that there are have the settings that we gave them.

    Open vSwitch gives its own to a new one (ofproto/connmgr.c, ofservice_create), and ours to those
    that there are when something else has changed that it reads in its database.
    """
    vsctl(NO_WAIT, "set", "Bridge", bridge, f"other_config:{OWNER_KEY}-connected=true")


def certify(owner: str, authority: str, certificate: str, private_key: str) -> None:
    """Show this certificate in TLS; raise NetworkError if somebody else has set another."""
    others = _certified_for()
    if others is not None and not (others == owner or owners.gone(others)):
        raise NetworkError(
            "Open vSwitch has one certificate for all its bridges, and another is set: run without "
            "--tls, or beside it by `qmn apart`; `ovs-vsctl get-ssl` shows it"
        )
    files = {"private_key": private_key, "certificate": certificate, "ca_cert": authority}
    words = [f'{name}="{path}"' for name, path in files.items()]
    made = ["--id=@tls", "create", "SSL", *words, f"{OWNER}={owner}"]
    vsctl("del-ssl", "--", *made, "--", "set", "Open_vSwitch", ".", "ssl=@tls")


def forget_certificate(is_ours: Callable[[str], bool]) -> None:
    """Take away the certificate that a run of ours has set, if it is still there."""
    owner = _certified_for()
    if owner and is_ours(owner):
        vsctl(NO_WAIT, "del-ssl")  # the switch daemon may have ended with a run's bridges


def _certified_for() -> str | None:
    """Return which run has set the certificate, "" if none of ours has, None if there is none."""
    return next(map(_owner_in, _selected("SSL", "external_ids")), None)


def management(bridge: str) -> Path:
    """Return the socket by which programs ask for a bridge by its name, as ovs-ofctl does."""
    return RUN_FOLDER / f"{bridge}.mgmt"


def _snoop(bridge: str) -> Path:
    """Return the other socket that a bridge has, whose name nobody else takes."""
    return RUN_FOLDER / f"{bridge}.snoop"


def await_end(bridges: Iterable[str]) -> None:
    """Wait until the switch daemon, too, has no bridges of these names, which the database has not.

    It asks a database that has ended again only some seconds after that has come back, and has
    until then what was deleted meanwhile: new bridges of these names would be merged with it, and
    as it forgets old ports, it would shut new interfaces of their names. Raise NetworkError if it
    keeps one.
    """
    doubtful = {name for name in bridges if management(name).exists() or _snoop(name).exists()}
    if not doubtful:
        return
    watched, deadline = daemons(), time.monotonic() + OPENVSWITCH_TIMEOUT_S
    while kept := doubtful & _bridges_of_the_switch_daemon(watched):
        if time.monotonic() > deadline:
            raise NetworkError(
                f"{SWITCH_DAEMON} did not forget bridge {min(kept)}, which was deleted, in "
                f"{OPENVSWITCH_TIMEOUT_S:g} s: {RESTART}"
            )
        time.sleep(POLL_S)


def _bridges_of_the_switch_daemon(watched: Mapping[str, Owner]) -> set[str]:
    """Return the bridges that the switch daemon has, whatever the database says.

    One that has just started knows of the question only from its first look at the database on.
    """
    try:
        said = run(
            *("ovs-appctl", "-t", SWITCH_DAEMON, "ofproto/list"),
            timeout_s=OPENVSWITCH_COMMAND_TIMEOUT_S,
            check=lambda: require_alive(watched),
        )
    except NetworkError as error:
        if "is not a valid command" in str(error):
            return set()
        raise
    return set(said.split())


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
    log = LOG_FOLDER / f"{SWITCH_DAEMON}.log"
    raise NetworkError(f"Open vSwitch did not make {name}: {why or f'its log, {log}, says why'}")


def delete(*names: str) -> None:
    """Delete bridges of ours, those that are there.

    Where the daemon has ended that would remove their interfaces, remove those that nobody holds.
    """
    words = [word for name in sorted(names) for word in ("--", "--if-exists", "del-br", name)][1:]
    if not words:
        return
    if DATABASE not in daemons():
        raise NetworkError(
            f"bridges {', '.join(sorted(names))} stay, as {DATABASE} does not run: {RESTART}; the "
            "next run removes them then, and so does `qmn clean`"
        )
    for name in names:
        remove_agent_sockets(name)
    if _answers(found := daemons(), SWITCH_DAEMON):
        with packet_sockets.held(found[SWITCH_DAEMON].pid):
            vsctl(*words)
        return
    others = vsctl(NO_WAIT, *words, "--", "list-br").split()
    interfaces.delete(*names, *([] if others else [DATAPATH_INTERFACE]))


def delete_finally(owner: str, *names: str) -> None:
    """Delete bridges of ours where Open vSwitch has nothing to do for this run any more.

    Its userspace datapath takes time with the square of the ports to delete them. Where this run
    has started it, and there are no other bridges, its switch daemon ends instead, and all that
    it has goes with it; see `revive_if_ours`. A database that has ended meanwhile comes back first:
    it alone can forget bridges.
    """
    if names and DATABASE not in daemons():
        revive_if_ours(owner)
    found = daemons()
    is_ours = found.keys() == set(DAEMONS) and starter() == owner
    if names and is_ours and datapath() == "user" and set(bridges()) <= set(names):
        with packet_sockets.held(found[SWITCH_DAEMON].pid):
            _end_now(SWITCH_DAEMON, found[SWITCH_DAEMON])
        if DATABASE not in daemons():
            revive_if_ours(owner)
    delete(*names)


def _end_now(name: str, daemon: Owner) -> None:
    """End a daemon; raise NetworkError if the kernel does not free it in time."""
    limit_s = OPENVSWITCH_TIMEOUT_S + INTERFACE_S * len(interfaces.all_here())
    deadline = time.monotonic() + limit_s
    owners.end([daemon])
    while daemon.alive:
        if time.monotonic() > deadline:
            raise NetworkError(f"{name} (process {daemon.pid}) did not end in {limit_s:g} s")
        time.sleep(POLL_S)


def agent_socket(bridge: str) -> Path:
    """Return where the agent of a quantum switch listens: one socket a controller, numbered."""
    return RUN_FOLDER / f"{bridge}.agent"


def remove_agent_sockets(bridge: str) -> None:
    """Remove what an agent that has ended has left."""
    for left in RUN_FOLDER.glob(f"{bridge}.agent[0-9]*"):
        left.unlink(missing_ok=True)


def datapath() -> str:
    """Return "kernel" where Open vSwitch's kernel module is loaded, else "user".

    Starting Open vSwitch loads the module if the machine has one. A container sees the
    module of the machine it is on, which is not its own to use.
    """
    in_container = os.environ.get("QMN_MODE") == "docker"
    loaded = Path("/sys/module/openvswitch").exists()
    return "kernel" if loaded and not in_container else "user"
