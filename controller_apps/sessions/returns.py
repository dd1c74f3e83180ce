"""Sessions that go back on the light of another one, which was opened by the other end.

    source ---> A    source ---> B    A ---> B      a session of superdense coding, A to B
                                      B ---> A      its return: this path alone is its own

Pairs of either come to both hosts. So a return stands and falls with the session that it is of.
"""

from collections.abc import Iterator

from controller_apps.light.paths import Network
from controller_apps.light.routing import LightPath, rotation_of
from controller_apps.packets import FiveTuple
from controller_apps.sessions.sessions import Session, Sessions
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Service
from wire.optical import ANY_WAVELENGTH
from wire.services import RETURNS


def returned_on(setup: Setup, five_tuple: FiveTuple, sessions: Sessions) -> Session | None:
    candidates = (
        session
        for session in sessions.by_number.values()
        if session.open
        and session.paths
        and session.setup.service == RETURNS[Service(setup.service)]
        and session.setup.handshake == Handshake.FRAMED
        and session.setup.source == setup.source
        and setup.wavelength_pm in (ANY_WAVELENGTH, session.wavelength_pm)
        and session.owner.source == five_tuple.destination
        and session.owner.destination == five_tuple.source
    )
    return next(candidates, None)


def returns_of(session: Session, sessions: Sessions) -> list[Session]:
    """Return the sessions that go back on the light of this one."""
    return [
        other
        for other in sessions.by_number.values()
        if other.setup.service in RETURNS
        and returned_on(other.setup, other.owner, sessions) is session
    ]


def borrowed_rotation(
    setup: Setup, five_tuple: FiveTuple, sessions: Sessions, network: Network
) -> int:
    """Return what light paths that are not a session's own do to its pairs."""
    if setup.service not in RETURNS:
        return 0
    session = returned_on(setup, five_tuple, sessions)
    assert session is not None
    return rotation_of(_from_source(session, network))


def _from_source(session: Session, network: Network) -> Iterator[LightPath]:
    """Yield the paths that pairs come by: a tap may have divided any of them into two."""
    opener, source = session.owner.source, session.setup.source
    comes_from = source
    for path in session.paths:
        start = network.hosts[path.leg.start].address
        if start in (opener, source):
            comes_from = start
        if comes_from == source:
            yield path
