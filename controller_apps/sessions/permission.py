"""Holds a set-up against the policy: turns addresses into names, and counts what is open."""

from collections.abc import Iterator
from dataclasses import dataclass

from controller_apps.light.paths import Network
from controller_apps.packets.segments import FiveTuple
from controller_apps.policy.policy import Host, Policy, SessionRequest
from controller_apps.sessions.sessions import Sessions
from wire.metadata import Handshake, Service, Setup
from wire.services import RETURNS

PARTS = (Service.PAIR_SOURCE, Service.LINK)  # of sessions that were asked for before


@dataclass
class Permission:
    """The policy in force; it may be replaced, and sessions that are open then stay."""

    policy: Policy
    network: Network
    sessions: Sessions

    def objection(self, setup: Setup, five_tuple: FiveTuple) -> str:
        """Return why the policy forbids a set-up, "" if it does not.

        A pair source is asked for a session that is open already, and so is a link of a chain of
        repeaters: the policy has been asked about the whole. A host that has not been
        discovered has no name; admission refuses it for that.
        """
        if setup.service in PARTS:
            return ""
        request = self._request(setup, five_tuple)
        return self.policy.objection(request, self._open(setup.session)) if request else ""

    def _open(self, but: int) -> Iterator[SessionRequest]:
        for session in self.sessions.by_number.values():
            request = self._request(session.setup, session.owner)
            if session.number != but and session.setup.service not in PARTS and request is not None:
                yield request

    def _request(self, setup: Setup, five_tuple: FiveTuple) -> SessionRequest | None:
        sender, receiver = self._party(five_tuple.source), self._party(five_tuple.destination)
        source = self._party(setup.source)
        if sender is None or receiver is None or source is None:
            return None
        pairs = 1 if setup.handshake == Handshake.PER_PAIR else setup.pairs
        service = Service(setup.service)
        name = RETURNS.get(service, service).name.lower()
        return SessionRequest(
            name, sender, receiver, source, setup.rate_hz, pairs, setup.frame_bytes
        )

    def _party(self, address: str) -> Host | None:
        """Return a host that has announced a fibre, by the address it has announced."""
        ports = self.network.ports_of(address)
        return Host(self.network.hosts[ports[0]].host, address) if ports else None
