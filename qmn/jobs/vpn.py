"""qmn run vpn: a VPN between two hosts, keyed by their photons; a file moves through it."""

import os
import shutil
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path

from rich.console import Console

from hosts.middleware.session.service_options import MAX_COUNT
from qmn.jobs import eavesdropping, moments
from qmn.jobs.keys import show
from qmn.jobs.moments import Moments
from qmn.jobs.passing_eavesdropper import PassingEavesdropper, PassingEve
from qmn.jobs.run_context import RunContext, ending, known_facts, running_network
from qmn.jobs.run_options import RunOptions
from qmn.jobs.tunnel import (
    MovedFile,
    carried_by,
    died,
    no_dead_sockets,
    require_running,
    serve_and_download,
    start_tunnel,
)
from qmn.network.checks import check_network, check_two_hosts
from qmn.network.description import NetworkDescription, describe_network
from qmn.network.options import NetworkOptions
from qmn.network.time_scale import REAL
from qmn.options import BadInput, check_ranges
from qmn.results import result
from qmn.results.run_folder import begin_folder
from topologies.daemons.key_managers import KeyService, start_key_managers
from topologies.networks.network import Network, Signals, require_root
from topologies.system.processes.programs import NetworkError, Program
from topologies.timeouts import POLL_S
from wire.key_manager import KeyLink
from wire.parameters.option import option
from wire.results.figures import TunnelFigures
from wire.results.moments import ClosedMoment, HandshakeMoment, Moment
from wire.results.run_result import KeysJob, Parameter
from wire.vpn import PROGRAMS, STRONGSWAN, TLS, WIREGUARD

NAME = "vpn"
NEEDED = {  # programs, and the Debian packages that have them
    WIREGUARD: (("wireguard-go", "wg"), "wireguard-go wireguard-tools"),
    STRONGSWAN: (
        ("charon-systemd", "swanctl"),
        "charon-systemd strongswan-swanctl libcharon-extra-plugins "
        "libstrongswan-standard-plugins libstrongswan-extra-plugins",
    ),
    TLS: (("openssl", "setpriv"), "openssl util-linux"),
}
# Timers that are not ours, which `--time-scale` does not slow down.
OWN_TIMERS = {
    WIREGUARD: "WireGuard's (a handshake again after 5 s, other keys after 120 s) and TCP's",
    STRONGSWAN: "IKE's (a message again after 4 s and more, other keys after an hour) and TCP's",
    TLS: "TCP's",
}
ENOUGH = 4096  # keys that are never there: sessions follow one another, and notice who listens
DEFAULT_S = 20.0  # that the default file takes at the rate that is asked for


@dataclass(frozen=True, kw_only=True)
class VpnRequest:
    """What the tunnel is made with, how often its key changes, and what goes through it."""

    program: str = option(
        WIREGUARD, "what makes the tunnel (wireguard)", flag="--with", choices=PROGRAMS
    )
    sender: str = option("alice", "that asks for keys (alice)", flag="--from", metavar="HOST")
    receiver: str = option("bob", "that has the file (bob)", flag="--to", metavar="HOST")
    rotate: float = option(2.0, "a new key so often (2)", metavar="S", range=(0.5, 3_600))
    lifetime: float = option(
        5.0,
        "no key is used for longer (5)",
        flag="--key-lifetime",
        metavar="S",
        range=(1.0, 86_400),
    )
    session_bits: int = option(
        12_000,
        "sifted bits of a session that makes keys (12000)",
        metavar="N",
        range=(1, MAX_COUNT),
    )
    mbit_s: float = option(4.0, "at which the file comes (4)", metavar="MBIT", range=(0.1, 1_000))
    file: Path | None = option(
        None, f"to move (random bytes that take {DEFAULT_S:g} s)", metavar="FILE"
    )
    seconds: float = option(
        90.0, "until the file has to be there (90)", metavar="S", range=(1.0, 86_400)
    )
    eve: PassingEve
    network: NetworkOptions
    run: RunOptions


def checked(request: VpnRequest) -> tuple[VpnRequest, NetworkDescription]:
    """Return the request with what follows from it, and its network.

    Raise BadInput or BadTopology before anything is started.
    """
    if request.eve.eve is not None:
        request = replace(request, network=eavesdropping.with_eve(request.network))
    network, ends = describe_network(request.network), (request.sender, request.receiver)
    check_two_hosts(*ends, network.hosts, network.dark_hosts)
    check_network(request.network)
    check_ranges(request.run)
    check_ranges(request)
    request.eve.check(ends, network)
    if request.lifetime <= request.rotate:
        raise BadInput(
            f"--key-lifetime {request.lifetime:g}: choose more than --rotate {request.rotate:g}"
        )
    if request.file is not None and not request.file.is_file():
        raise BadInput(f"cannot read {request.file}: it is not a file")
    names, packages = NEEDED[request.program]
    missing = [name for name in names if shutil.which(name) is None]
    if missing:
        raise BadInput(f"{missing[0]} is not installed: apt-get install {packages}")
    return request, network


def run(request: VpnRequest, signals: Signals, console: Console) -> int:
    """Do the whole run and return its exit status."""
    request, description = checked(request)
    require_root()
    folder = begin_folder(request.run.runs, NAME)
    eve = passing_eve(request, description, folder)
    context = RunContext(eve.with_policy(description), request.run, folder, signals, console)
    kept, hosts = KeysJob(), (request.sender, request.receiver)
    facts = known_facts(context, NAME, hosts, kept, parameters(request))
    with ending(folder, facts, result.complete, context.options.report) as ended:
        with no_dead_sockets(hosts), running_network(context, facts) as network:
            use_network(request, network, eve, context, kept)
        facts.delivered = isinstance(kept.asking, TunnelFigures) and kept.asking.file_intact
    result.show(console, facts, folder, ended.report)
    return 0 if facts.delivered else 1


def passing_eve(
    request: VpnRequest, network: NetworkDescription, folder: Path
) -> PassingEavesdropper:
    """Return who may come to the light."""
    begin = eavesdropping.sender_of_light("bb84", request.sender, network)
    return PassingEavesdropper(request.eve, begin, request.receiver, folder)


def parameters(request: VpnRequest) -> dict[str, Parameter | None]:
    """Return what the result keeps of what was asked."""
    names = ("program", "sender", "receiver", "rotate", "lifetime", "session_bits", "mbit_s")
    said = {name: getattr(request, name) for name in names}
    return said | (vars(request.eve) if request.eve.eve is not None else {})


def use_network(
    request: VpnRequest,
    network: Network,
    eve: PassingEavesdropper,
    context: RunContext,
    kept: KeysJob,
) -> None:
    """Make keys, a tunnel of them, and move the file through it; add what comes of it."""
    ends = request.sender, request.receiver
    link = KeyLink("", True, ENOUGH, ENOUGH, pause_s=1.0, options={"count": request.session_bits})
    managers = start_key_managers(network, KeyService([ends], link, withhold=True))
    context.console.print(
        f"{request.program} between {ends[0]} and {ends[1]}, a new key every {request.rotate:g} s"
    )
    if network.runtime.time.scale != REAL:
        context.console.print(
            f"timers on the wall clock: {OWN_TIMERS[request.program]}", soft_wrap=True
        )
    watched = {host: managers.programs[host] for host in ends}
    noted = Moments(watched, network.runtime.time, partial(show, context.console))
    kept.moments = noted.all
    tunnel = start_tunnel(
        network, managers, ends, request.rotate, request.lifetime, request.program
    )
    for host, program in zip(ends, tunnel.programs[:2], strict=True):
        noted.listen(host, program)
    file = file_of(request, context.folder)
    with carried_by(tunnel.programs):
        moved = serve_and_download(network, tunnel, file, context.folder, request.mbit_s)
    noted.listen(request.sender, moved.download)
    try:
        watch(network, noted, eve, [*tunnel.programs, moved.server], moved, request.seconds)
    finally:
        noted.finish()
        kept.asking = counted(noted, moved, file)


def file_of(request: VpnRequest, folder: Path) -> Path:
    """Return the file to move."""
    if request.file is not None:
        return request.file.resolve()
    file = folder / "file"
    file.write_bytes(os.urandom(int(request.mbit_s * 1e6 / 8 * DEFAULT_S)))
    return file


def watch(
    network: Network,
    noted: Moments,
    eve: PassingEavesdropper,
    programs: list[Program],
    moved: MovedFile,
    seconds: float,
) -> None:
    """Gather what happens until the file is there; NetworkError if it is not in time."""
    while True:
        running = moved.download.running  # asked first, so that no line after it is missed
        network.check()
        noted.gather()
        eve.look(network, noted)
        require_running(programs)
        if not running:
            if moved.download.status:
                raise died(moved.download)
            return
        if noted.now_s > seconds:
            raise NetworkError(
                f"the file was not there in {seconds:g} s: the tunnel was closed for "
                f"{closed_s(noted.all, noted.now_s):.1f} s; give it more --seconds"
            )
        time.sleep(POLL_S)


def counted(noted: Moments, moved: MovedFile, file: Path) -> TunnelFigures:
    """Return what the run came to."""
    elapsed_s = noted.now_s
    handshakes = [each.seconds for each in noted.all if isinstance(each, HandshakeMoment)]
    arrived = moved.output.exists() and not moved.download.running
    return TunnelFigures(
        **vars(moments.summary(noted.all, elapsed_s)),
        keys_used=len(handshakes),
        longest_handshake_s=max(handshakes, default=None),
        tunnel_closed_s=closed_s(noted.all, elapsed_s),
        file_bytes=file.stat().st_size,
        received_bytes=moved.output.stat().st_size if moved.output.exists() else 0,
        file_intact=arrived and digest(moved.output) == digest(file),
    )


def closed_s(all_moments: Iterable[Moment], until_s: float) -> float:
    """Return for how long one end had closed the tunnel, after it was open first."""
    closed, since_s, total_s = set[str](), 0.0, 0.0  # hosts
    for moment in all_moments:
        if isinstance(moment, ClosedMoment):
            since_s = since_s if closed else moment.at
            closed.add(moment.host)
        elif moment.event == "tunnel_opened" and moment.host in closed:
            closed.remove(moment.host)
            total_s += 0.0 if closed else moment.at - since_s
    return total_s + (until_s - since_s if closed else 0.0)


def digest(file: Path) -> str:
    """Return the SHA-256 of a file."""
    with file.open("rb") as opened:
        whole = sha256()
        while part := opened.read(1 << 20):
            whole.update(part)
    return whole.hexdigest()
