"""Options of a network before it starts: the same for `qmn run`, `qmn cli` and scripts.

The command line has them as options, Python as keywords: --length-km 2 and length_km=2.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

from controller_apps.policy.reading import BadPolicy, policy_file, read_policy
from qmn.network.time_scale import PACED, STEPPED, Pace, time_mode
from qmn.options import BadInput
from topologies.catalogue.node_kinds import NODE_KINDS
from topologies.catalogue.presets import PRESETS
from topologies.system.runs.runtime import Runtime
from wire.parameters.fiber import KINDS
from wire.parameters.network import NetworkSettings
from wire.parameters.option import SIMULATION, option

EVERY = "of every fibre"
MAP = "map"  # the topology
NETWORK = "the network"  # the group of options


def parameter(default: Any, meaning: str) -> Any:
    """Return a field that --topology has as a parameter, and scripts as a keyword."""
    return option(default, meaning, flag="")


GONE = "repeaters_at", "stations"  # parameters of earlier topologies, and of their results


@dataclass(frozen=True, kw_only=True)
class ShapeOptions:
    """Which nodes and fibres a network has: parameters of topologies."""

    map: str | None = parameter(
        None, "abilene, nobel-germany, garr, …, or a file (docs/networks.md)"
    )
    hosts_at: str | None = parameter(None, "places of the map, with commas, with hosts (all)")
    sources_at: str | None = parameter(None, "places with pair sources (the centre)")
    fibers: int | None = parameter(None, "fibres between neighbouring quantum switches (2)")
    repeaters: int | None = parameter(None, "hosts of a line between alice and bob, 1 to 64 (1)")
    hosts: int | None = parameter(None, "hosts of a tree of switches, 2 to 1024 (16)")
    switches: int | None = parameter(None, "quantum switches of a chain, ring or tree")
    leaves: int | None = parameter(None, "switches of leaf-spine with hosts (3)")
    spines: int | None = parameter(None, "switches of leaf-spine between leaves (2)")
    both_ways: bool = parameter(False, "alice has two fibres, so that she can receive, too")


@dataclass(frozen=True, kw_only=True)
class LightOptions:
    GROUP: ClassVar[str] = "light and noise"
    preset: str = option("ideal", "values of fibres and devices (ideal)", choices=tuple(PRESETS))
    length_km: float | None = option(None, f"length {EVERY} (0.01)", metavar="KM")
    loss_db_per_km: float | None = option(None, f"loss {EVERY} (0)", metavar="DB")
    depolarizing: float | None = option(
        None, f"noise {EVERY}: X, Y and Z each with probability P/4 (0)", metavar="P"
    )
    kind: str | None = option(
        None, f"kind {EVERY}: standard or polarisation-maintaining, …", choices=tuple(KINDS)
    )
    fiber: tuple[str, ...] = option(
        (),
        f"parameter {EVERY}, as burst_end_hz=10, or of those between two nodes, as "
        "q1-q2.length_km=40 (repeatable; docs/fibers.md)",
        metavar="[A-B.]NAME=VALUE",
    )
    switch: tuple[str, ...] = option(
        (),
        "parameter of every quantum switch, as insertion_loss_db=1.2, or of one, as "
        "q1.insertion_loss_db=1, or of parts, as q1.memory.t2_s=0.1 (docs/switch-swaps.md)",
        metavar="[NAME.][PART.]NAME=VALUE",
    )
    node: tuple[str, ...] = option(
        (),
        f"kind of all hosts, or of one: {' or '.join(NODE_KINDS)} (repeatable; docs/nodes.md)",
        metavar="[HOST=]KIND",
    )
    device: tuple[str, ...] = option(
        (),
        "parameter of a device of a host, as bob.detectors.efficiency=0.8, or of every one, as "
        "'*.memory.t2_s=100ms' (repeatable; docs/devices.md)",
        metavar="HOST.PART.NAME=VALUE",
    )
    channels: int | None = option(None, f"channels {EVERY}, by wavelength (1)", metavar="N")


@dataclass(frozen=True, kw_only=True)
class TimeOptions:
    GROUP: ClassVar[str] = SIMULATION
    time: str | None = option(
        None,
        f"{STEPPED}: it stands while software runs; {PACED}: by the wall; {PACED}=K: a second of "
        f"the network takes K seconds here ({STEPPED} where it can be; docs/time.md)",
        metavar="MODE",
        parse=time_mode,
        recorded=False,
    )


@dataclass(frozen=True, kw_only=True)
class NetworkOptions(ShapeOptions, LightOptions, TimeOptions, NetworkSettings):
    """Options of a network: its settings, nodes and fibres."""

    topology: str = ""  # its name, or FILE.py:CLASS; empty: a script's own

    def __post_init__(self) -> None:
        """Take the topology of maps if a map is named, but no topology."""
        if self.map is not None and not self.topology:
            object.__setattr__(self, "topology", MAP)

    def by_policy(self) -> Self:
        """Return the options as their policy has them; raise BadInput if it cannot be used."""
        try:
            copies = read_policy(self.policy).metadata_at_switch if self.policy else None
        except BadPolicy as error:
            raise BadInput(str(error)) from error
        return replace(self, metadata_at_switch=copies) if copies else self


def settings(
    options: NetworkOptions,
    folder: Path | None,
    pace: Pace,
    record: bool = False,
    qasm: bool = False,
    events: bool = True,
) -> Runtime:
    """Return the settings of a network that leaves its logs in a folder; None: leaves none."""
    paths = {name: getattr(options, name) for name in ("sabot", "keys", "tls_from", "tags")}
    paths["policy"] = options.policy and policy_file(options.policy)
    whole: dict[str, Any] = {
        name: str(Path(path).resolve()) for name, path in paths.items() if path
    }
    return Runtime(
        settings=replace(options, **whole, tls=options.tls or bool(options.tls_from)),
        time_scale=pace.scale,
        log_folder=folder,
        record=record,
        qasm=qasm,
        events=events,
        stepped=pace.stepped,
    )
