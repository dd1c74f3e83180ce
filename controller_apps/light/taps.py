"""Hosts that are put on a fibre: light between two hosts goes by way of a third.

    alice ---> bob        becomes        alice ---> eve's first fibre
                                         eve's second fibre ---> bob

That host alone decides about the light; if it does nothing, none comes out.
"""

from collections.abc import Sequence

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Network, natural_order
from controller_apps.light.routing import Leg
from controller_apps.policy.policy import Tap
from wire.metadata.vocabulary import Reason

FIBERS_NEEDED = 2


class CannotTap(ValueError):
    """A tap that the network does not allow; the message says which and what to do."""

    def __init__(self, reason: Reason, text: str) -> None:
        super().__init__(text)
        self.reason = reason


def tapped(
    legs: Sequence[Leg], network: Network, taps: Sequence[Tap], frequency_mhz: int
) -> list[Leg]:
    """Return the legs of this light, each that a tap is on divided in two; raise CannotTap."""
    return [part for leg in legs for part in _parts(leg, network, taps, frequency_mhz)]


def _parts(leg: Leg, network: Network, taps: Sequence[Tap], frequency_mhz: int) -> list[Leg]:
    ends = {network.hosts[at].host for at in leg}
    for tap in taps:
        if set(tap.between) == ends:
            inward, outward = _fibers(tap, network, frequency_mhz)
            return [Leg(leg.start, inward), Leg(outward, leg.end)]
    return [leg]


def _fibers(tap: Tap, network: Network, frequency_mhz: int) -> list[SwitchPort]:
    """Return where the first two fibres of the host that taps are, by their channel if they have.

    Raise CannotTap if it has none, or too few.
    """
    named = {
        host.name: at
        for at, host in network.hosts.items()
        if host.host == tap.by and network.optics.is_of_channel(at, frequency_mhz)
    }
    if not named:
        hosts = ", ".join(sorted({host.host for host in network.hosts.values()}))
        raise CannotTap(
            Reason.UNKNOWN_HOST,
            f"{tap}: {tap.by!r} is not a host that has announced a fibre; those are {hosts}",
        )
    if len(named) < FIBERS_NEEDED:
        raise CannotTap(
            Reason.NO_PATH,
            f"{tap}: {tap.by} has {len(named)} fibre, a tap needs {FIBERS_NEEDED}; add one, or "
            "take the tap out of the policy",
        )
    return [named[name] for name in sorted(named, key=natural_order)[:FIBERS_NEEDED]]
