"""The protocol of conference key agreement at all hosts of a line: no socket, no clock.

    leader                      next                        last
      | Envelope(PROPOSAL) ------> | Envelope(PROPOSAL) ----> |  its terms
      | (ghz/line.py)              |                          |  GHZ states, block by block:
      | <-------- Values(RECEIPT)  | <----- Values(RECEIPT)   |  all have a block in memory
      | Values(BASES) -----------> | Values(BASES) ---------> |  what each state is for; measured
      | <------- Values(OUTCOMES)  | <---- Values(OUTCOMES)   |  of tests, and what was not seen
      | Values(ARRIVED) ---------> | Values(ARRIVED) -------> |  that all have seen
      | Values(COUNTS, SYNDROME) > | -----------------------> |  errors of the worst; parities
      | Envelope(HASH) ----------> | Envelope(HASH) --------> |  of the bits
      | <------- Values(OUTCOMES)  | <---- Values(OUTCOMES)   |  whether they are corrected
      | Values(COUNTS, AMPLIFY) -> | -----------------------> |  length, seed
      | Values(TAGS) ------------> | Values(TAGS) ----------> |  proofs of all this, both ways; the
      | <----------- Values(TAGS)  | <-------- Values(TAGS)   |  key is in the store behind them
      | Values(KEPT) ------------> | Values(KEPT) ----------> |  and in that of the leader

Messages to a host pass the hosts before it, which could change them: the tags show that.
Their meaning is decided in applications.qkd.conference; leader.py and follower.py say who does
what, and here is what both need.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from uuid import UUID

import numpy as np

from applications.ghz.line import Right
from applications.ghz.options import GhzOptions
from applications.key_distribution.options import bound_option, check_decoder
from applications.qkd.authentication import TAG_BYTES, ForgedMessage, KeyPoolExhausted
from applications.qkd.bits import Bits
from applications.qkd.conference import Contradiction, Pools
from applications.qkd.conference_proposal import ConferenceProposal
from applications.qkd.key_store import KEY_BITS, key_id
from hosts.middleware.session.errors import SessionError, unsupported
from hosts.middleware.session.protocol import Hear, Say, Steps
from hosts.middleware.session.values import Numbers
from wire.malformed import MalformedPacket
from wire.metadata.values import Envelope, Topic
from wire.metadata.vocabulary import Reason
from wire.outcomes import BASES
from wire.parameters.option import option

IN_BASIS = np.array([BASES.index(name) for name in "ZXZ"], np.uint8)  # KEY, TEST_X, TEST_Z
NO_BLOCK = 0
FORGED = "a message was changed on its way: the tag over all messages is wrong"


@dataclass(frozen=True)
class Keys:
    """The keys of a host: those that it authenticates with, and those that it makes."""

    shared: Callable[[ConferenceProposal, str], Pools]  # of the leader and another host
    store: Callable[[ConferenceProposal, Bits], None]
    withdraw: Callable[[ConferenceProposal, list[UUID]], None]


def key_ids(terms: ConferenceProposal, final: Bits) -> list[UUID]:
    return [key_id(terms.session, number) for number in range(final.size // KEY_BITS)]


@contextmanager
def honest() -> Iterator[None]:
    """Turn what cannot be, or is not proved, into the end of the session."""
    try:
        yield
    except ForgedMessage as error:
        raise SessionError(Reason.PROTOCOL, f"no key: {FORGED}") from error
    except KeyPoolExhausted as error:
        raise SessionError(Reason.NOT_ALLOWED, f"no key: {error}") from error
    except (Contradiction, MalformedPacket) as error:
        raise SessionError(Reason.PROTOCOL, f"no key: {error}") from error


def tags_of(numbers: Numbers) -> list[bytes]:
    return [tag.tobytes() for tag in numbers.astype(np.uint8).reshape(-1, TAG_BYTES)]


def enveloped(topic: Topic, timeout_s: float) -> Steps[bytes]:
    message: Envelope = yield Hear(Envelope, timeout_s)
    if message.topic != topic:
        text = f"no key: an envelope of topic {message.topic}, not {topic.name}"
        raise SessionError(Reason.PROTOCOL, text)
    return message.content


def envelope(right: Right, topic: Topic, content: bytes) -> Say:
    return Say((Envelope(right.side.setup.session, topic, content),))


MAX_STATES = 1_000_000  # of one key: the seed of its privacy amplification is one message


@dataclass(frozen=True)
class ConferenceOptions(GhzOptions):
    """`count` states that all hosts have seen, of which one key is distilled."""

    count: int = option(100_000, "states (100000)", metavar="N", range=(1, MAX_STATES))
    test_fraction: float = option(
        0.1, "of the states, tested in X, and as many in Z (0.1)", metavar="F"
    )
    max_qber: float = option(0.1, "no key above this error rate of any test (0.1)", metavar="Q")
    epsilon: float = option(1e-10, "that the key is not secret, at most (1e-10)", metavar="P")
    bound: str = bound_option()

    def check(self) -> None:
        super().check()
        check_decoder()
        for name, most in (("test_fraction", 0.5), ("max_qber", 0.5), ("epsilon", 1)):
            value = getattr(self, name)
            if not isinstance(value, float) or not 0 < value < most:
                raise unsupported(f"{name} {value!r}: choose a fraction between 0 and {most}")
