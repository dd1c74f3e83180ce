"""qmn run vpn: a VPN between two hosts, keyed by their photons; a file moves through it."""

import os
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from shutil import which

from rich.console import Console

from applications.keys import time_series
from applications.keys.config import KeyLink
from applications.keys.job import time_series_of
from applications.keys.key_managers import KeyService, start_key_managers
from applications.keys.scheduled_eavesdropper import ScheduledEavesdropper, check_schedule
from applications.keys.time_series import TimeSeries
from applications.vpn.format import STRONGSWAN, TLS, WIREGUARD
from applications.vpn.request import DEFAULT_S, VpnRequest
from applications.vpn.tunnel import (
    MovedFile,
    carried_by,
    died,
    no_dead_sockets,
    require_running,
    serve_and_download,
    start_tunnel,
)
from qmn.jobs import eavesdropping
from qmn.jobs.run_context import RunContext, ending, known_facts, running_network
from qmn.network.checks import FROM_TO, check_network, check_two_hosts
from qmn.network.description import NetworkDescription, describe_network
from qmn.network.felt_settings import checked_settings, everything, felt_by
from qmn.network.light_checks import check_light
from qmn.options import BadInput, check_ranges
from qmn.results import result
from qmn.results.run_folder import begin_folder
from topologies.networks.network import Network, Signals
from topologies.networks.requirements import require_free
from topologies.system.machines.machine import Machine
from topologies.system.processes.programs import NetworkError, Program
from topologies.timeouts import POLL_S
from wire.results.figures import TunnelFigures
from wire.results.run_result import KeysJob
from wire.results.time_series import ClosedMoment, HandshakeMoment, Moment

NAME = "vpn"
NEEDED = {  # programs, and the Debian packages that have them
    WIREGUARD: (("wireguard-go", "wg"), "wireguard-go wireguard-tools"),
    STRONGSWAN: (
        ("charon-systemd",),
        "charon-systemd strongswan-swanctl libcharon-extra-plugins "
        "libstrongswan-standard-plugins libstrongswan-extra-plugins",
    ),
    TLS: (("openssl", "setpriv"), "openssl util-linux"),
}
# Timers that are not ours, which `--time paced=K` does not slow down.
OWN_TIMERS = {
    WIREGUARD: "WireGuard's (a handshake again after 5 s, other keys after 120 s) and TCP's",
    STRONGSWAN: "IKE's (a message again after 4 s and more, other keys after an hour) and TCP's",
    TLS: "TCP's",
}
ENOUGH = 4096  # keys that are never there: sessions follow one another, and notice who listens
PROTOCOL = "bb84"  # of the sessions that make keys


def checked(request: VpnRequest) -> tuple[VpnRequest, NetworkDescription]:
    """Return the request with what follows from it, and its network.

    Raise BadInput or BadTopology before anything is started.
    """
    if request.eve.eve is not None:
        request = replace(request, network=eavesdropping.with_eve(request.network))
    network = describe_network(request.network).paced_for("tunnels have timers of their own")
    ends = network.node(request.sender), network.node(request.receiver)
    request = replace(request, sender=ends[0], receiver=ends[1])
    check_two_hosts(ends[0], ends[1], network.hosts, network.dark_hosts, FROM_TO)
    check_light(PROTOCOL, ends, network.parts)
    felt = felt_by(PROTOCOL, ends, network.parts)
    if request.eve.eve is not None:
        felt |= everything([eavesdropping.EVE])
    network = checked_settings(PROTOCOL, felt, network)
    check_network(request.network)
    check_ranges(request.run)
    check_ranges(request)
    check_schedule(request.eve, ends, network)
    if request.lifetime <= request.rotate:
        raise BadInput(
            f"--key-lifetime {request.lifetime:g}: choose more than --rotate {request.rotate:g}"
        )
    if request.file is not None and not request.file.is_file():
        raise BadInput(f"cannot read {request.file}: it is not a file")
    if request.run.machines == 1 and not request.run.place:
        require_installed(request, {})
    return request, network


def require_installed(request: VpnRequest, places: Mapping[str, Machine]) -> None:
    """Raise BadInput if the machine of an end lacks a program that makes the tunnel.

    `places` are those of hosts that are not on this one.
    """
    names, packages = NEEDED[request.program]
    for host in (request.sender, request.receiver):
        machine = places.get(host)
        missing = machine.lacks(names) if machine else [n for n in names if which(n) is None]
        if missing:
            where = f" on {machine.name}, where {host} is" if machine else ""
            raise BadInput(f"{missing[0]} is not installed{where}: apt-get install {packages}")


def run(request: VpnRequest, signals: Signals, console: Console) -> int:
    request, description = checked(request)
    require_free(description.topo)
    folder = begin_folder(request.run.runs, NAME)
    eve = scheduled_eavesdropper(request, description, folder)
    context = RunContext(eve.with_policy(description), request.run, folder, signals, console)
    job, hosts = KeysJob(), (request.sender, request.receiver)
    facts = known_facts(context, NAME, hosts, job, request)
    with ending(folder, facts, result.complete, context.options.report) as ended:
        prepare = partial(require_installed, request)
        with no_dead_sockets(hosts), running_network(context, facts, prepare) as network:
            use_network(request, network, eve, context, job)
        facts.delivered = isinstance(job.asking, TunnelFigures) and job.asking.file_intact
    result.show(console, facts, folder, ended.report)
    return 0 if facts.delivered else 1


def scheduled_eavesdropper(
    request: VpnRequest, network: NetworkDescription, folder: Path
) -> ScheduledEavesdropper:
    path = eavesdropping.tapped_path(PROTOCOL, (request.sender, request.receiver), "", network)
    return ScheduledEavesdropper(request.eve, *path, folder)


def use_network(
    request: VpnRequest,
    network: Network,
    eve: ScheduledEavesdropper,
    context: RunContext,
    job: KeysJob,
) -> None:
    """Make keys, a tunnel of them, and move the file through it; add the outcome."""
    ends = request.sender, request.receiver
    link = KeyLink("", True, ENOUGH, ENOUGH, pause_s=1.0, options={"count": request.session_bits})
    managers = start_key_managers(network, KeyService([ends], link, withhold=True))
    context.console.print(
        f"{request.program} between {ends[0]} and {ends[1]}, a new key every {request.rotate:g} s"
    )
    if network.runtime.time.scale != 1.0:
        context.console.print(
            f"timers on the wall clock: {OWN_TIMERS[request.program]}", soft_wrap=True
        )
    watched = {host: managers.programs[host] for host in ends}
    noted = time_series_of(network, watched, context.console)
    job.time_series = noted.all
    tunnel = start_tunnel(network, ends, request.rotate, request.lifetime, request.program)
    for host, program in zip(ends, tunnel.programs[:2], strict=True):
        noted.listen(host, program)
    file = file_of(request, context.folder)
    with carried_by(network, tunnel.programs):
        moved = serve_and_download(network, tunnel, file, context.folder, request.mbit_s)
    noted.listen(request.sender, moved.download)
    try:
        watch(network, noted, eve, [*tunnel.programs, moved.server], moved, request.seconds)
    finally:
        noted.finish()
        network.bring_back(moved.download)
        job.asking = counted(noted, moved, file)


def file_of(request: VpnRequest, folder: Path) -> Path:
    if request.file is not None:
        return request.file.resolve()
    file = folder / "file"
    file.write_bytes(os.urandom(int(request.mbit_s * 1e6 / 8 * DEFAULT_S)))
    return file


def watch(
    network: Network,
    noted: TimeSeries,
    eve: ScheduledEavesdropper,
    programs: list[Program],
    moved: MovedFile,
    seconds: float,
) -> None:
    """Gather events until the file has arrived; NetworkError if it comes too late."""
    while True:
        running = moved.download.running  # asked first, so that no line after it is missed
        network.check()
        noted.gather()
        eve.look(network, noted)
        try:
            require_running(programs)
            if not running and moved.download.status:
                raise died(moved.download)
        except NetworkError:
            network.explain()  # its host or its machine may have ended first
            raise
        if not running:
            return
        if noted.now_s > seconds:
            raise NetworkError(
                f"the file was not there in {seconds:g} s: {hindrance(noted.all, noted.now_s)}"
            )
        time.sleep(POLL_S)


def hindrance(series: Sequence[Moment], until_s: float) -> str:
    """Return what has kept a tunnel from its file until now, or what to do."""
    last = next(reversed(time_series.sessions(series)), None)
    if last is not None and last.event == "failed":
        return f"no keys, as {last.host}'s last session failed: {last.text}"
    closed = closed_s(series, until_s)
    return f"the tunnel was closed for {closed:.1f} s; give it more --seconds"


def counted(noted: TimeSeries, moved: MovedFile, file: Path) -> TunnelFigures:
    elapsed_s = noted.now_s
    handshakes = [each.seconds for each in noted.all if isinstance(each, HandshakeMoment)]
    arrived = moved.output.exists() and not moved.download.running
    return TunnelFigures(
        **vars(time_series.summary(noted.all, elapsed_s)),
        keys_used=len(handshakes),
        longest_handshake_s=max(handshakes, default=None),
        tunnel_closed_s=closed_s(noted.all, elapsed_s),
        file_bytes=file.stat().st_size,
        received_bytes=moved.output.stat().st_size if moved.output.exists() else 0,
        file_intact=arrived and digest(moved.output) == digest(file),
    )


def closed_s(series: Iterable[Moment], until_s: float) -> float:
    """Return for how long one end had closed the tunnel, after it was open first."""
    closed, since_s, total_s = set[str](), 0.0, 0.0  # hosts
    for moment in series:
        if isinstance(moment, ClosedMoment):
            since_s = since_s if closed else moment.at
            closed.add(moment.host)
        elif moment.event == "tunnel_opened" and moment.host in closed:
            closed.remove(moment.host)
            total_s += 0.0 if closed else moment.at - since_s
    return total_s + (until_s - since_s if closed else 0.0)


def digest(file: Path) -> str:
    with file.open("rb") as opened:
        whole = sha256()
        while part := opened.read(1 << 20):
            whole.update(part)
    return whole.hexdigest()
