"""The errors of sessions: why one cannot go on, and what a person can do about it."""

from wire.metadata.header import Message
from wire.metadata.setup import Answer
from wire.metadata.vocabulary import Reason

REMEDIES = {
    Reason.NOT_ARBITRATED: "no controller has granted the light path; is c0 running and does "
    "its switch send quantum metadata to it?",
    Reason.NO_LISTENER: "no application listens on that port; start the receiver first",
    Reason.UNKNOWN_HOST: "the controller has not seen the fibres of sender, receiver and source",
    Reason.NO_PATH: "no light path joins sender, receiver and source; each needs the fibres that "
    "the service asks for (for bytes the receiver and the source two, the sender one of its own; "
    "for the way back in a ready topology: both_ways)",
    Reason.PATH_BROKEN: "no light path is whole: a fibre between quantum switches is cut, a "
    "cross-connect is stuck or a switch is away; who runs the network can say which",
    Reason.BUSY: "another session uses these fibres; try again when it has ended",
    Reason.TOO_LATE: "others have the light until the deadline; ask for a later one, or of higher "
    "priority if the policy orders by it",
    Reason.NOT_ALLOWED: "the controller's policy does not allow this service between these "
    "hosts, or not at this rate, frame size or number of sessions; ask who runs the network to "
    "change its policy file (`qmn run --policy`)",
    Reason.LOSS_TOO_HIGH: "every free light path loses more than the controller's loss budget; "
    "raise the budget (`--loss-budget-db`), or use shorter or better fibres",
    Reason.NO_WAVELENGTH: "no light path can be tuned to this wavelength from end to end; choose "
    "one that every port on the way offers (`wavelength_pm`; the default is 1550120)",
    Reason.UNKNOWN_SESSION: "the controller knows no such session",
    Reason.UNSUPPORTED: "the other end does not offer what was asked for",
    Reason.SWITCH_FAILED: "the quantum switch has not set up the light path: it sent an error, or "
    "lost its connection to the controller; see the logs of its agent and of the controller",
    Reason.SWITCH_TIMEOUT: "the quantum switch was not ready in time; is its agent running?",
    Reason.SETUP_UNSEEN: "a quantum switch has got no copy of the set-up message itself, and the "
    "network demands it (`--metadata-at-switch required`); is its copper whole?",
    Reason.NO_CHAIN: "no chain of 1 to 64 switches that swap joins these hosts; each needs a free "
    "Bell analyser, of several also two memories and a source (`--switch analysers=1`). In "
    "heralded chains stations and switches with memories that emit take turns",
}

SAME_VERSION = "do both hosts run the same version?"


class SessionError(Exception):
    """A session cannot go on; the reason travels to the other end, the text to a person."""

    def __init__(self, reason: Reason, text: str = "") -> None:
        super().__init__(text or REMEDIES[reason])
        self.reason = reason


class SilentPeer(SessionError):
    """Nothing came in time."""


def unsupported(text: str) -> SessionError:
    return SessionError(Reason.UNSUPPORTED, text)


def unexpected(message: Message | None, peer: str) -> SessionError:
    """Return the error that a message is: a refusal, or one that has no place in a session."""
    if message is None:
        text = f"{peer} is gone: it closed the connection in mid-session; ask again when it is up"
        return SessionError(Reason.PEER_GONE, text)
    if isinstance(message, Answer) and message.reason != Reason.OK:
        return SessionError(Reason(message.reason), message.text)
    text = f"{type(message).__name__} from {peer} in mid-session, where it has no place; "
    text += SAME_VERSION
    return SessionError(Reason.PROTOCOL, text)
