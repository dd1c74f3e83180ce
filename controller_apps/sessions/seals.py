"""Ways that seals watch, and those that are closed because of an alarm.

    granted(seal)   its way is known, also when the seal is over
    watched(seal)   between which switches light went there: what the policy has closed at an alarm
    forget(seal)    its light was taken from it: what it says of the way is worth nothing

A host is believed only about seals that it has opened. No socket, no clock.
"""

from collections.abc import Iterable

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop, Network
from controller_apps.sessions.sessions import Session
from wire.metadata.vocabulary import Service

Ways = frozenset[frozenset[str]]  # pairs of switches, by their names
MOST_SEALS = 1024  # that are remembered
NOWHERE: Ways = frozenset()


class Seals:
    """The ways of the last seals, by session."""

    def __init__(self, network: Network) -> None:
        """Begin with none."""
        self._network = network
        self._watched: dict[int, tuple[str, Ways]] = {}  # the opener's address, and its way
        self.closed: Ways = NOWHERE  # by alarms

    def granted(self, session: Session | None) -> None:
        if session is None or session.setup.service != Service.SEAL:
            return
        self._watched.pop(session.number, None)
        self._watched[session.number] = session.owner.source, self._ways(session.hops)
        if len(self._watched) > MOST_SEALS:
            del self._watched[next(iter(self._watched))]

    def watched(self, number: int, host: str) -> Ways:
        opener, ways = self._watched.get(number, ("", NOWHERE))
        return ways if opener == host else NOWHERE

    def is_of(self, number: int, host: str) -> bool:
        return self._watched.get(number, ("", NOWHERE))[0] == host

    def forget(self, number: int) -> None:
        self._watched.pop(number, None)

    def close(self, ways: Ways) -> None:
        """Keep ways closed until the policy is read again."""
        self.closed |= ways

    def _ways(self, hops: Iterable[Hop]) -> Ways:
        network, ways = self._network, set()
        for hop in hops:
            far = network.links.get(SwitchPort(hop.dpid, hop.out_port))
            if far is not None:
                ways.add(frozenset({network.name_of(hop.dpid), network.name_of(far.dpid)}))
        return frozenset(ways)


def names_of(ways: Ways) -> list[str]:
    return sorted("-".join(sorted(way)) for way in ways)
