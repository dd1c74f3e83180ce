"""Options of a network before it starts: the same for `qmn run`, `qmn cli` and scripts.

The command line has them as options, Python as keywords: --length-km 2 and length_km=2.
"""

from dataclasses import dataclass
from pathlib import Path

from qmn.network.time_scale import AUTO, REAL, scale
from qmn.options import option
from topologies.copper_link import MOST_KM
from topologies.node_kinds import NODE_KINDS
from topologies.presets import PRESETS
from topologies.runtime import OPENFLOW_PORT, Runtime
from wire.config import BACKENDS, CONTENTION
from wire.parameters.fiber import KINDS

EVERY = "of every fibre"
PLACES = "PLACES"
MAP = "map"  # the topology


@dataclass(frozen=True, kw_only=True)
class NetworkOptions:
    """What can be said of a network, each option declared here alone."""

    topology: str = ""  # its name, or FILE.py:CLASS; empty: a script's own
    seed: int = option(1, "of all quantum randomness (1)")
    time_scale: float | str = option(
        REAL,
        f"one second of the network takes K seconds here ({REAL}; {AUTO}: as slowly as it needs)",
        metavar="K",
        parse=scale,
    )
    backend: str = option("chp", "simulates quantum states (chp)", choices=BACKENDS)
    sabot: str = option("", "simulate in a Sabot server (in ed itself)", metavar="SOCKET")
    controller: str = option("ryu", "default: ryu", choices=("ryu", "os-ken"))
    openflow_port: int = option(OPENFLOW_PORT, "of c0 (6653)", metavar="PORT", range=(1, 65_535))
    preset: str = option("ideal", "fibres and devices (ideal)", choices=tuple(PRESETS))
    length_km: float | None = option(None, f"{EVERY} (0.01)", metavar="KM")
    loss_db_per_km: float | None = option(None, f"{EVERY} (0)", metavar="DB")
    depolarizing: float | None = option(
        None, f"{EVERY}: X, Y and Z each with probability P/4 (0)", metavar="P"
    )
    kind: str | None = option(
        None, f"{EVERY}: standard or polarisation-maintaining", choices=tuple(KINDS)
    )
    fiber: tuple[str, ...] = option(
        (),
        f"{EVERY}, as burst_end_hz=10, or of those between two nodes, as q1-q2.length_km=40 "
        "(repeatable; docs/physical-layer.md)",
        metavar="[A-B.]NAME=VALUE",
    )
    switch: tuple[str, ...] = option(
        (),
        "of every quantum switch, as insertion_loss_db=1.2, or of one, as q1.insertion_loss_db=1",
        metavar="[NAME.]NAME=VALUE",
    )
    node: tuple[str, ...] = option(
        (),
        f"what all hosts are, or one: {' or '.join(NODE_KINDS)} (repeatable; docs/nodes.md)",
        metavar="[HOST=]KIND",
    )
    device: tuple[str, ...] = option(
        (),
        "of a host, as bob.detectors.efficiency=0.8 (repeatable; docs/physical-layer.md)",
        metavar="HOST.PART.NAME=VALUE",
    )
    map: str | None = option(
        None,
        "over a known map: abilene, nobel-germany, garr, …, or a file (docs/networks.md)",
        metavar="NAME|FILE",
    )
    hosts_at: str | None = option(None, "of the map, with commas: have hosts (all)", metavar=PLACES)
    sources_at: str | None = option(None, "have pair sources (the centre)", metavar=PLACES)
    repeaters_at: str | None = option(
        None, "have hosts that can be repeaters (all)", metavar=PLACES
    )
    fibers: int | None = option(None, "between neighbouring quantum switches (2)", metavar="N")
    repeaters: int | None = option(None, "of a chain of them, 1 to 16", metavar="N")
    switches: int | None = option(None, "quantum switches of a chain or ring", metavar="N")
    leaves: int | None = option(None, "switches of leaf-spine with hosts (3)", metavar="N")
    spines: int | None = option(None, "switches of leaf-spine between leaves (2)", metavar="N")
    copper_km: float | None = option(
        None,
        "length of every copper cable (that of the fibres between the same places)",
        metavar="KM",
        range=(0, MOST_KM),
    )
    control_km: float | None = option(
        None,
        "length of the copper between c0 and every switch (as other copper)",
        metavar="KM",
        range=(0, MOST_KM),
    )
    control_loss: float = option(
        0.0,
        "share of the packets between c0 and every switch that are lost (0)",
        metavar="P",
        range=(0, 0.9),
    )
    loss_budget_db: float = option(30.0, "of a light path (30)", metavar="DB", range=(0, 1_000))
    contention: str = option("refuse", "if light is taken", choices=CONTENTION)
    policy: Path | None = option(
        None, "who may do what, in TOML (allow everything)", metavar="FILE"
    )
    rest: str = option("", "serve what c0 knows there, over HTTP", metavar="ADDRESS")
    apps: tuple[str, ...] = option(
        (),
        "load a controller app beside ours, such as ryu.app.ofctl_rest (more than once)",
        flag="--app",
        metavar="MODULE",
    )
    # Where keys stay, for networks over which keys may be distributed.
    keys: Path | None = option(
        None,
        "keep the keys that hosts make here, a new folder (they go with the network)",
        metavar="DIR",
    )
    metrics: bool = option(False, "figures for Prometheus (docs/metrics.md)")
    history_depth: int = option(10_000, "events kept (10000)", metavar="N", range=(0, 10_000_000))
    per_qubit: int = option(
        0,
        "write an event for each of the first N photons of a block (1000), too",
        metavar="N",
        const=1000,
        range=(0, 1_000_000),
    )

    def __post_init__(self) -> None:
        """Take a map, if one is named, in place of the topology that a job has by default."""
        if self.map is not None:
            object.__setattr__(self, "topology", MAP)


KEYS = ("keys",)  # the options of networks over which keys may be distributed


def settings(
    options: NetworkOptions,
    folder: Path | None,
    time_scale: float,
    record: bool = False,
    qasm: bool = False,
    events: bool = True,
) -> Runtime:
    """Return the settings of a network that leaves its logs in a folder; None: leaves none."""
    return Runtime(
        seed=options.seed,
        time_scale=time_scale,
        backend=options.backend,
        sabot=options.sabot and str(Path(options.sabot).resolve()),
        record=record,
        qasm=qasm,
        events=events,
        per_qubit=options.per_qubit,
        framework=options.controller,
        openflow_port=options.openflow_port,
        copper_km=options.copper_km,
        control_km=options.control_km,
        control_loss=options.control_loss,
        history_depth=options.history_depth,
        loss_budget_db=options.loss_budget_db,
        contention=options.contention,
        log_folder=folder,
        policy=str(options.policy.resolve()) if options.policy else "",
        rest=options.rest,
        apps=[*options.apps],
        metrics=options.metrics,
        keys=str(options.keys.resolve()) if options.keys else "",
    )
