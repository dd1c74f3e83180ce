"""The protocol of conference key agreement at all hosts of a line: no socket, no clock.

    leader                      next                        last
      | Envelope(PROPOSAL) ------> | Envelope(PROPOSAL) ----> |  wire.conference
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

What is said to a host goes by way of those before it, who could change it: the tags show that.
What it means is decided in hosts.middleware.qkd.conference.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any
from uuid import UUID

import numpy as np

from hosts.hardware.qnic import Qnic, Symbols
from hosts.middleware.qkd import conference
from hosts.middleware.qkd.amplification import seed_bits
from hosts.middleware.qkd.authentication import (
    HASH_KEY_BYTES,
    TAG_BYTES,
    ForgedMessage,
    KeyPoolExhausted,
)
from hosts.middleware.qkd.bits import Bits, unpack
from hosts.middleware.qkd.conference import KEY, TEST_X, TEST_Z, Contradiction, Member, Pools
from hosts.middleware.qkd.estimation import Estimate
from hosts.middleware.qkd.key_store import KEY_BITS, key_id
from hosts.middleware.services.conference.options import MAX_STATES, ConferenceOptions
from hosts.middleware.services.conference.summary import summary
from hosts.middleware.services.ghz import line
from hosts.middleware.services.ghz.line import Right, Table
from hosts.middleware.services.key_distribution.options import BOUNDS
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Hear, Now, Say, Steps, Tell, Work, do, hear
from hosts.middleware.session.values import MAX_WORD, Numbers, expect
from hosts.timeouts import BITS_TIMEOUT_S, KEYS_TIMEOUT_S, REPORT_TIMEOUT_S
from wire.conference import ConferenceProposal
from wire.metadata import Envelope, MalformedPacket, Reason, Topic, Values
from wire.outcomes import BASES

EPS_COR = 1e-15
IN_BASIS = np.array([BASES.index(name) for name in "ZXZ"], np.uint8)  # KEY, TEST_X, TEST_Z
NO_BLOCK = 0
FORGED = "not everything that was said came as it was said: somebody on the way has changed it"


@dataclass(frozen=True)
class Keys:
    """The keys of a host: those that it authenticates with, and those that it makes."""

    shared: Callable[[ConferenceProposal, str], Pools]  # of the leader and another host
    store: Callable[[ConferenceProposal, Bits], None]
    withdraw: Callable[[ConferenceProposal, list[UUID]], None]


def key_ids(terms: ConferenceProposal, final: Bits) -> list[UUID]:
    """Return by which names all know the keys that are made of a final key."""
    return [key_id(terms.session, number) for number in range(final.size // KEY_BITS)]


@contextmanager
def _honest() -> Iterator[None]:
    """Turn what cannot be, or is not proved, into the end of the session."""
    try:
        yield
    except ForgedMessage as error:
        raise SessionError(Reason.PROTOCOL, f"no key: {FORGED}") from error
    except KeyPoolExhausted as error:
        raise SessionError(Reason.NOT_ALLOWED, f"no key: {error}") from error
    except (Contradiction, MalformedPacket) as error:
        raise SessionError(Reason.PROTOCOL, f"no key: {error}") from error


@dataclass
class Leader(line.Leader):
    """The host that asks: its bits count as right."""

    options: ConferenceOptions
    keys: Keys = field(kw_only=True)
    began_s: float = 0.0

    def run(self) -> Steps[None]:
        """Propose, make states and measure them, and make a key of that."""
        names, options = tuple(self.options.names), self.options
        session, bound = self.side.setup.session, BOUNDS[options.bound]
        terms = ConferenceProposal(session, bound, options.epsilon, EPS_COR, names)
        self.key = conference.Leader(terms, [self.keys.shared(terms, name) for name in names[1:]])
        self.began_s = yield Now()
        yield from self.right.tell(_envelope(self.right, Topic.PROPOSAL, terms.encode()))
        yield from super().run()
        yield from self._distil()

    @property
    def states(self) -> int:
        """Return how many states all have seen."""
        return self.key.states

    def figures(self) -> dict[str, Any]:
        """Return nothing more: what tests say is told at the end."""
        return {}

    def use(self, number: int, states: int) -> Steps[None]:
        """Say what each state is for, and measure them."""
        right, fraction = self.right, self.options.test_fraction
        yield from self._see_receipts(number, states)
        drawn = self.side.draws.random(states)
        kinds = np.select([drawn < fraction, drawn < 2 * fraction], [TEST_X, TEST_Z], KEY)
        kinds = kinds.astype(np.uint8)
        shape = len(self.options.names) - 1, states
        theirs = yield from right.ask(Topic.BASES, number, kinds, 2, shape)
        own = line.seen((yield from do(Qnic.measure, right.block(number), IN_BASIS[kinds])))
        with _honest():
            kept = self.key.add_block(kinds, own, theirs)
        yield from right.tell(right.side.say(Topic.ARRIVED, number, kept, 1))

    def _see_receipts(self, number: int, states: int) -> Steps[None]:
        size = TAG_BYTES * (len(self.options.names) - 1)
        told = yield from self.right.hear(Topic.RECEIPT, number, size, 255, BITS_TIMEOUT_S)
        with _honest():
            self.key.check_receipts(number, states, _tags(told))

    def _distil(self) -> Steps[None]:
        key, right, others = self.key, self.right, len(self.options.names) - 1
        self._judge()
        worst, parities = key.worst, (yield Work(key.parities, ()))
        proof = conference.proved(key.raw, self.side.draws.bytes(HASH_KEY_BYTES))
        side = right.side
        yield from right.tell(
            side.say(Topic.COUNTS, NO_BLOCK, [worst.errors, worst.sample], 32),
            side.say(Topic.SYNDROME, NO_BLOCK, parities, 1),
            _envelope(right, Topic.HASH, proof),
        )
        agree = yield from right.hear(Topic.OUTCOMES, NO_BLOCK, others, 1, KEYS_TIMEOUT_S)
        if not agree.all():
            names = zip(self.options.names[1:], agree, strict=True)
            wrong = ", ".join(name for name, equal in names if not equal)
            text = f"no key: the corrected bits of {wrong} differ: nothing is delivered"
            raise SessionError(Reason.WRONG_DIGEST, text)
        length, count = key.length, seed_bits(key.raw.size)
        seed = unpack(self.side.draws.bytes((count + 7) // 8), count)
        yield from right.tell(
            side.say(Topic.COUNTS, NO_BLOCK, [length], 32),
            side.say(Topic.AMPLIFY, NO_BLOCK, seed, 1),
        )
        final = yield Work(key.amplified, (parities, proof, length, seed))
        yield from self._prove(final)

    def _prove(self, final: Bits) -> Steps[None]:
        """Keep the key if all others know what was said, as they do."""
        key, right = self.key, self.right
        tags = key.tags()
        told = np.frombuffer(b"".join(tags), np.uint8)
        yield from right.tell(right.side.say(Topic.TAGS, NO_BLOCK, told, 8))
        heard = yield from right.hear(Topic.TAGS, NO_BLOCK, told.size, 255, KEYS_TIMEOUT_S)
        with _honest():
            key.check(_tags(heard))
        ids, kept = key_ids(key.terms, final), False
        try:
            yield Work(self.keys.store, (key.terms, final))
            yield from right.tell(right.side.say(Topic.KEPT, NO_BLOCK, [], 1))
            kept = True
        finally:
            if not kept:
                self.keys.withdraw(key.terms, ids)
        elapsed_s = (yield Now()) - self.began_s
        yield Tell(summary(key, final.size, ids, elapsed_s) | self._light())

    def _light(self) -> dict[str, int]:
        return {"made": self.made, "emitted": self.emitted}

    def _judge(self) -> None:
        """Raise SessionError if no key can come of what was measured."""
        key, most = self.key, self.options.max_qber
        names = self.options.names[1:]
        tests = {"the parity in X": key.in_x}
        tests |= {f"{name} in Z": found for name, found in zip(names, key.in_z, strict=True)}
        for what, found in tests.items():
            if found.sample and found.qber > most:
                raise SessionError(
                    Reason.TOO_NOISY,
                    f"no key: of {found.sample} tests of {what} {found.errors} are wrong "
                    f"({found.qber:.4f}), at most {most:g}: noise or an eavesdropper",
                )
        if key.length == 0:
            text = f"no secret bit in {key.raw.size} bits of {key.states} states"
            text += f" with an error rate of {key.in_x.qber:.4f} in X" if key.in_x.sample else ""
            raise SessionError(Reason.TOO_NOISY, f"no key: {text}: measure more, or --count more")


@dataclass
class Follower(line.Follower):
    """A host that another has asked."""

    keys: Keys = field(kw_only=True)
    ids: list[UUID] = field(default_factory=list)
    kept: bool = False  # by the leader, too
    key_bits: int = 0

    def run(self) -> Steps[None]:
        """Hear the proposal, and do what the line does; keep no key that the leader has not."""
        content = yield from _enveloped(Topic.PROPOSAL, REPORT_TIMEOUT_S)
        with _honest():
            terms = ConferenceProposal.decode(content)
        place = len(terms.names) - 1 - self.behind
        if place < 1 or terms.names[place] != self.side.host:
            text = f"no key: {self.side.host} is not in its place of {', '.join(terms.names)}"
            raise SessionError(Reason.PROTOCOL, text)
        self.member = Member(terms, self.side.host, self.keys.shared(terms, self.side.host))
        if self.right is not None:
            yield from self.right.tell(_envelope(self.right, Topic.PROPOSAL, content))
        try:
            yield from super().run()
        finally:
            if self.ids and not self.kept:
                self.keys.withdraw(terms, self.ids)

    def figures(self) -> dict[str, Any]:
        """Return what this host's application is told."""
        first = str(self.ids[0]) if self.ids else None
        key = {"key_bits": self.key_bits, "keys": len(self.ids), "first_key_id": first}
        return super().figures() | key

    def heard(self, message: Values) -> Steps[None]:
        """Take part in a block of states, or in making the key of them."""
        if message.topic != Topic.COUNTS:
            yield from super().heard(message)
            return
        errors, sample = expect(message, Topic.COUNTS, NO_BLOCK, 2, MAX_WORD).tolist()
        if not 0 < sample <= MAX_STATES or errors > sample:
            raise SessionError(Reason.PROTOCOL, f"no key: {errors} errors of {sample}")
        yield from self._pass_on(self.side.say(Topic.COUNTS, NO_BLOCK, [errors, sample], 32))
        yield from self._correct(Estimate(errors, sample))
        final = yield from self._amplified()
        yield from self._prove(final)

    def use(self, number: int, states: int) -> Steps[None]:
        """Measure each state by what it is for, and tell outcomes of tests."""
        yield from self._give_receipt(number, states)
        heard = yield from hear(Topic.BASES, number, states, TEST_Z, BITS_TIMEOUT_S)
        kinds, others = heard.astype(np.uint8), list[Table]()
        if self.right is not None:
            shape = self.behind, states
            others.append((yield from self.right.ask(Topic.BASES, number, kinds, 2, shape)))
        name = self.side.block(number, half=1)
        own: Symbols = line.seen((yield from do(Qnic.measure, name, IN_BASIS[kinds])))
        yield self.answer(number, conference.disclosed(kinds, own), others)
        told = yield from hear(Topic.ARRIVED, number, states, 1, BITS_TIMEOUT_S)
        yield from self._pass_on(self.side.say(Topic.ARRIVED, number, told, 1))
        with _honest():
            self.member.add_block(kinds, own, told.astype(bool))

    def _give_receipt(self, number: int, states: int) -> Steps[None]:
        """Prove that this host has a block, and pass on what proves it of those behind."""
        others: Numbers = np.zeros(0, np.uint32)
        if self.right is not None:
            size = TAG_BYTES * self.behind
            others = yield from self.right.hear(Topic.RECEIPT, number, size, 255, BITS_TIMEOUT_S)
        with _honest():
            own = np.frombuffer(self.member.receipt(number, states), np.uint8)
        yield self.side.say(Topic.RECEIPT, number, np.concatenate([own, others]), 8)

    def _correct(self, worst: Estimate) -> Steps[None]:
        """Correct, and tell whether it and those behind have the leader's bits."""
        heard = yield from hear(Topic.SYNDROME, NO_BLOCK, None, 1, KEYS_TIMEOUT_S)
        parities = heard.astype(np.uint8)
        yield from self._pass_on(self.side.say(Topic.SYNDROME, NO_BLOCK, parities, 1))
        proof = yield from _enveloped(Topic.HASH, KEYS_TIMEOUT_S)
        if self.right is not None:
            yield from self.right.tell(_envelope(self.right, Topic.HASH, proof))
        with _honest():
            agrees = yield Work(self.member.correct, (worst, parities, proof))
        others: Numbers = np.zeros(0, np.uint32)
        if self.right is not None:
            most = KEYS_TIMEOUT_S
            others = yield from self.right.hear(Topic.OUTCOMES, NO_BLOCK, self.behind, 1, most)
        yield self.side.say(Topic.OUTCOMES, NO_BLOCK, [agrees, *others], 2)

    def _amplified(self) -> Steps[Bits]:
        most = self.member.raw.size
        (length,) = yield from hear(Topic.COUNTS, NO_BLOCK, 1, most, KEYS_TIMEOUT_S)
        heard = yield from hear(Topic.AMPLIFY, NO_BLOCK, seed_bits(most), 1, KEYS_TIMEOUT_S)
        seed = heard.astype(np.uint8)
        yield from self._pass_on(
            self.side.say(Topic.COUNTS, NO_BLOCK, [length], 32),
            self.side.say(Topic.AMPLIFY, NO_BLOCK, seed, 1),
        )
        with _honest():
            final: Bits = yield Work(self.member.amplified, (int(length), seed))
        return final

    def _prove(self, final: Bits) -> Steps[None]:
        """Keep the key if the leader knows what was said, as this host does."""
        count = TAG_BYTES * (1 + self.behind)
        heard = yield from hear(Topic.TAGS, NO_BLOCK, count, 255, KEYS_TIMEOUT_S)
        tags = heard.astype(np.uint8).tobytes()
        proof = self.member.tag()
        with _honest():
            self.member.check(tags[:TAG_BYTES])
        others: Numbers = np.zeros(0, np.uint32)
        if self.right is not None:
            rest, size = np.frombuffer(tags[TAG_BYTES:], np.uint8), TAG_BYTES * self.behind
            yield from self.right.tell(self.right.side.say(Topic.TAGS, NO_BLOCK, rest, 8))
            others = yield from self.right.hear(Topic.TAGS, NO_BLOCK, size, 255, KEYS_TIMEOUT_S)
        self.ids = key_ids(self.member.terms, final)
        yield Work(self.keys.store, (self.member.terms, final))
        told = np.concatenate([np.frombuffer(proof, np.uint8), others])
        yield self.side.say(Topic.TAGS, NO_BLOCK, told, 8)
        yield from hear(Topic.KEPT, NO_BLOCK, 0, 0, KEYS_TIMEOUT_S)
        self.kept = True
        self.key_bits = final.size
        yield from self._pass_on(self.side.say(Topic.KEPT, NO_BLOCK, [], 1))

    def _pass_on(self, *said: Say) -> Steps[None]:
        """Tell those behind what was heard, under the session with the next one."""
        if self.right is None:
            return
        session = self.right.side.setup.session
        for each in said:
            messages = tuple(replace(message, session=session) for message in each.messages)
            yield from self.right.tell(Say(messages))


def _tags(told: Numbers) -> list[bytes]:
    return [tag.tobytes() for tag in told.astype(np.uint8).reshape(-1, TAG_BYTES)]


def _enveloped(topic: Topic, timeout_s: float) -> Steps[bytes]:
    message: Envelope = yield Hear(Envelope, timeout_s)
    if message.topic != topic:
        text = f"no key: an envelope of topic {message.topic}, not {topic.name}"
        raise SessionError(Reason.PROTOCOL, text)
    return message.content


def _envelope(right: Right, topic: Topic, content: bytes) -> Say:
    return Say((Envelope(right.side.setup.session, topic, content),))
