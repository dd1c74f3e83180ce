"""A request for a chain of repeaters waits until every node has answered its order.

set-up --> ordered --last answer--> granted
              `--refusal, silence--> refused, with the address of that node
"""

from dataclasses import dataclass

from controller_apps.policy.schedules import Purification
from controller_apps.sessions.actions import Action, Note, SwapsOrdered
from controller_apps.sessions.light_paths import Light
from controller_apps.sessions.sessions import Chain, Refusal, Request, Session, Sessions
from controller_apps.sessions.verdicts import Verdicts
from controller_apps.timeouts import NODE_TIMEOUT_S
from wire.metadata.vocabulary import Reason


@dataclass
class Ordering:
    """Acts on the sessions that have chains."""

    sessions: Sessions
    light: Light
    verdicts: Verdicts

    def order(
        self,
        request: Request,
        session: Session,
        chain: Chain,
        schedule: str,
        purification: Purification,
        blocks: int,
    ) -> list[Action]:
        """Tell the nodes of a chain what they do, and when; the request waits for them."""
        session.chain = chain
        request.unanswered = {stop.address for stop in chain}
        self.light.hold(request)
        return [SwapsOrdered(session.number, chain, schedule, purification, blocks)]

    def node_answered(self, number: int, node: str, reason: Reason, now: float) -> list[Action]:
        """Note what a node (its address) says; let the request on after the last."""
        session = self.sessions.by_number.get(number)
        request = session.requests.get(session.owner) if session is not None else None
        if request is None or node not in request.unanswered:
            return []
        if reason != Reason.OK:
            return self.verdicts.refuse(request, Refusal(reason, node, node), now)
        request.unanswered.discard(node)
        if request.unanswered:
            return []
        elapsed_ms = (now - request.started) * 1000
        return self.verdicts.grant(request, Note("chain_ready", number, elapsed_ms))

    def give_up(self, request: Request, now: float) -> list[Action]:
        """Refuse a request for which a node has been silent for too long."""
        session = self.sessions.of(request)
        if session is None or now - request.started < NODE_TIMEOUT_S:
            return []
        nodes = (stop.address for stop in session.chain)
        silent = next(node for node in nodes if node in request.unanswered)
        return self.verdicts.refuse(request, Refusal(Reason.NODE_SILENT, silent, silent), now)
