"""A request for a chain of repeaters waits until every node has answered its order.

set-up --> ordered --last answer--> granted
              `--refusal, silence--> refused, with the address of that node
"""

from dataclasses import dataclass

from controller_apps.policy.schedules import Purification
from controller_apps.sessions.actions import Action, Note, SwapsOrdered
from controller_apps.sessions.admission import Admission
from controller_apps.sessions.light_paths import Light
from controller_apps.sessions.sessions import Refusal, Request, Session, Sessions
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
        admission: Admission,
        schedule: str,
        purification: Purification,
    ) -> list[Action]:
        """Send their orders to the nodes of a chain; the request waits for their answers."""
        session.chain = admission.chain
        request.unanswered = {stop.address for stop in admission.chain}
        self.light.hold(request)
        return [
            SwapsOrdered(session.number, admission.chain, schedule, purification, admission.blocks)
        ]

    def node_answered(self, number: int, node: str, reason: Reason, now: float) -> list[Action]:
        """Note the answer of a node (its address); grant the request after the last."""
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
