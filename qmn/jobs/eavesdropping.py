"""--eve FRACTION: puts eve on the fibre of a run, and has her attack a fraction of the light.

By photon-number splitting she stands in for a way that loses more than hers: by --eve-hides-db.
"""

import math
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from qmn.network.description import NetworkDescription
from qmn.network.light_checks import loss_to_click
from qmn.network.options import NetworkOptions
from qmn.options import BadInput
from qmn.timeouts import START_TIMEOUT_S
from topologies.description.description import Description
from topologies.networks.network import Network
from topologies.system.processes.programs import Program, python
from wire.light import Role
from wire.metadata.vocabulary import Service
from wire.results.figures import EveFigures, Figures
from wire.results.run_result import ServiceJob
from wire.results.time_series import fields_of
from wire.services import beams
from wire.socket_calls import RESEND, SPLIT

EVE = "eve"
TOPOLOGY = "tapped"  # that has her


@dataclass(frozen=True)
class Attack:
    fraction: float  # of the photons
    kind: str = RESEND
    expected_db: float = 0.0  # of splitting: from her to a click, as both ends expect it
    onward_db: float = 0.0  # and as it is

    @property
    def words(self) -> list[str]:
        ways = "--expected-db", str(self.expected_db), "--onward-db", str(self.onward_db)
        return ["--attack", self.kind, *(ways if self.kind == SPLIT else ()), str(self.fraction)]


def splitting(hides_db: float, receiver: str, parts: Description) -> Attack:
    onward_db = loss_to_click(EVE, receiver, parts)
    if onward_db == math.inf:
        text = f"no light of {EVE} makes a detector of {receiver} click"
        raise BadInput(f"--eve-attack {SPLIT}: {text}")
    return Attack(1.0, SPLIT, onward_db + hides_db, onward_db)


def with_eve(network: NetworkOptions) -> NetworkOptions:
    return replace(network, topology=TOPOLOGY) if network.topology == "sdc" else network


def check(ends: Collection[str], network: NetworkDescription) -> None:
    """Raise BadInput if eve cannot be put on the fibre between these ends."""
    options = network.options
    if EVE not in network.hosts:
        raise BadInput(f"--eve: {options.topology} has no host eve; use --topology {TOPOLOGY}")
    if EVE in ends:
        raise BadInput("--eve: eve is sender or receiver; choose two others")
    if options.policy:
        raise BadInput("--eve makes a policy of its own: leave out --policy")


def tapped_path(
    service: str, ends: tuple[str, str], source: str, network: NetworkDescription
) -> tuple[str, str]:
    """Return from whom to whom the light goes that eve sees; ends ask, and are asked.

    That is light to the host that is asked, or if it measures none, light to the relay.
    """
    hosts = {Role.OPENER: ends[0], Role.ACCEPTOR: ends[1]}
    hosts[Role.SOURCE] = source or network.parts.source_for(ends[0])
    light = beams(Service[service.upper()])
    seen = next((beam for beam in light if beam.end.role == Role.ACCEPTOR), light[0])
    return hosts[seen.start.role], hosts[seen.end.role]


@contextmanager
def eavesdropping(
    network: Network, attack: Attack | None, result: ServiceJob, label: str = ""
) -> Iterator[None]:
    """Have eve attack meanwhile, if an attack is given; keep what she saw."""
    if attack is None:
        yield
        return
    command = [python(), "-m", "hosts.applications.intercept", *attack.words]
    eve = network.run_on(EVE, f"{label}{EVE}", [*command, "--stack", network.runtime.socket(EVE)])
    eve.wait_for("intercepting", START_TIMEOUT_S, network.check)
    try:
        yield
    finally:
        eve.stop()
        result.eve = summary_of(eve)


def summary_of(eve: Program) -> Figures | EveFigures:
    """Return her last figures; none if she was ended before."""
    for line in eve.log.read_text(errors="replace").splitlines():
        fields = fields_of(line)
        if fields.pop("event", None) == "done":
            return EveFigures(**fields)
    return Figures()
