"""Holds a set-up against the policy: turns addresses into names, and counts what is open."""

from collections.abc import Iterator
from dataclasses import dataclass

from controller_apps.light.paths import Network
from controller_apps.packets import FiveTuple
from controller_apps.policy.policy import Host, Policy, SessionRequest
from controller_apps.sessions.sessions import Sessions
from wire.metadata.header import is_number_of
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Service
from wire.services import LINES, RETURNS


@dataclass
class Permission:
    """The policy in force; it may be replaced, and sessions that are open then stay."""

    policy: Policy
    network: Network
    sessions: Sessions

    def objection(self, setup: Setup, five_tuple: FiveTuple) -> str:
        """Return why the policy forbids a set-up, "" if it does not.

        A pair source is asked for a session that is open already, which the policy has been asked
        about. A host that has not been discovered has no name; admission refuses it for that.
        """
        if setup.service == Service.PAIR_SOURCE:
            return ""
        if self.policy.filter.numbers and not self._is_own_number(setup, five_tuple):
            return f"session {setup.session:016x} is not of {five_tuple.source}, which opens it"
        request = self._request(setup, five_tuple)
        return self.policy.objection(request, self._open(setup.session)) if request else ""

    def _is_own_number(self, setup: Setup, five_tuple: FiveTuple) -> bool:
        """Tell whether a number is one of the opener's, or the next one of a line of hosts.

        Such a line is asked for by its first host; each host in it asks the next.
        """
        if is_number_of(setup.session, five_tuple.source):
            return True
        before = self.sessions.by_number.get((setup.session - 1) % (1 << 64))
        return (
            setup.service in LINES
            and before is not None
            and before.setup.service == setup.service
            and before.owner.destination == five_tuple.source
        )

    def _open(self, but: int) -> Iterator[SessionRequest]:
        for session in self.sessions.by_number.values():
            request = self._request(session.setup, session.owner)
            if session.number != but and request is not None:
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
        ports = self.network.ports_of(address)
        return Host(self.network.hosts[ports[0]].host, address) if ports else None
