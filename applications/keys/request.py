"""The request of keys that are kept, and of an eavesdropper who passes."""

from dataclasses import dataclass

from applications.keys.options import KeyServiceOptions
from qmn.network.options import NetworkOptions
from qmn.requests.run_options import RunOptions
from wire.parameters.option import option

MOST_S = 86_400.0


@dataclass(frozen=True, kw_only=True)
class EveSchedule:
    """Whether she comes, and when."""

    eve: float | None = option(
        None,
        "put eve on the fibre, who measures this fraction of the photons and resends them",
        metavar="FRACTION",
        range=(0.0, 1),
    )
    at: float = option(10.0, "when eve comes (10)", metavar="S", range=(0.0, MOST_S), of="eve")
    until: float | None = option(
        None, "when she leaves (never)", metavar="S", range=(0.0, MOST_S), of="eve"
    )


@dataclass(frozen=True, kw_only=True)
class KeysRequest:
    """Which keys are to be kept, for how long, and who comes meanwhile."""

    keys: KeyServiceOptions
    eve: EveSchedule
    network: NetworkOptions
    run: RunOptions
    seconds: float | None = option(
        None,
        "end after so long (when Ctrl-C comes)",
        metavar="S",
        range=(0.1, 30 * 86_400),
        recorded=False,
    )
