"""Another host of a conference key: it measures, corrects, and passes on what it hears."""

from dataclasses import dataclass, field, replace
from uuid import UUID

import numpy as np

from applications.conference.protocol import (
    IN_BASIS,
    MAX_STATES,
    NO_BLOCK,
    Keys,
    envelope,
    enveloped,
    honest,
    key_ids,
)
from applications.conference.service import ConferenceFollowerFigures
from applications.ghz import line
from applications.ghz.line import Table
from applications.qkd import conference
from applications.qkd.amplification import seed_bits
from applications.qkd.authentication import TAG_BYTES
from applications.qkd.bits import Bits
from applications.qkd.conference import TEST_Z, Member
from applications.qkd.conference_proposal import ConferenceProposal
from applications.timeouts import KEYS_TIMEOUT_S
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.estimation import Estimate
from hosts.middleware.session.protocol import Say, Steps, Work, do, hear
from hosts.middleware.session.values import MAX_WORD, Numbers, expect
from hosts.timeouts import BITS_TIMEOUT_S, REPORT_TIMEOUT_S
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason


@dataclass
class Follower(line.Follower):
    keys: Keys = field(kw_only=True)
    ids: list[UUID] = field(default_factory=list)
    kept: bool = False  # by the leader, too
    key_bits: int = 0

    def run(self) -> Steps[None]:
        """Hear the proposal, and do what the line does; keep no key that the leader has not."""
        content = yield from enveloped(Topic.PROPOSAL, REPORT_TIMEOUT_S)
        with honest():
            terms = ConferenceProposal.decode(content)
        place = len(terms.names) - 1 - self.behind
        if place < 1 or terms.names[place] != self.side.host:
            text = f"no key: {self.side.host} is not in its place of {', '.join(terms.names)}"
            raise SessionError(Reason.PROTOCOL, text)
        self.member = Member(terms, self.side.host, self.keys.shared(terms, self.side.host))
        if self.right is not None:
            yield from self.right.tell(envelope(self.right, Topic.PROPOSAL, content))
        try:
            yield from super().run()
        finally:
            if self.ids and not self.kept:
                self.keys.withdraw(terms, self.ids)

    def figures(self) -> ConferenceFollowerFigures:
        return ConferenceFollowerFigures(
            **vars(super().figures()),
            key_bits=self.key_bits,
            keys=len(self.ids),
            first_key_id=str(self.ids[0]) if self.ids else None,
        )

    def heard(self, message: Values) -> Steps[None]:
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
        outcomes: Symbols = line.seen((yield from do(Qnic.measure, name, IN_BASIS[kinds])))
        yield self.answer(number, conference.disclosed(kinds, outcomes), others)
        arrived = yield from hear(Topic.ARRIVED, number, states, 1, BITS_TIMEOUT_S)
        yield from self._pass_on(self.side.say(Topic.ARRIVED, number, arrived, 1))
        with honest():
            self.member.add_block(kinds, outcomes, arrived.astype(bool))

    def _give_receipt(self, number: int, states: int) -> Steps[None]:
        """Prove that this host has a block, and pass on what proves it of those behind."""
        others: Numbers = np.zeros(0, np.uint32)
        if self.right is not None:
            size = TAG_BYTES * self.behind
            others = yield from self.right.hear(Topic.RECEIPT, number, size, 255, BITS_TIMEOUT_S)
        with honest():
            receipt = np.frombuffer(self.member.receipt(number, states), np.uint8)
        yield self.side.say(Topic.RECEIPT, number, np.concatenate([receipt, others]), 8)

    def _correct(self, worst: Estimate) -> Steps[None]:
        """Correct, and tell whether it and those behind have the leader's bits."""
        heard = yield from hear(Topic.SYNDROME, NO_BLOCK, None, 1, KEYS_TIMEOUT_S)
        parities = heard.astype(np.uint8)
        yield from self._pass_on(self.side.say(Topic.SYNDROME, NO_BLOCK, parities, 1))
        proof = yield from enveloped(Topic.HASH, KEYS_TIMEOUT_S)
        if self.right is not None:
            yield from self.right.tell(envelope(self.right, Topic.HASH, proof))
        with honest():
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
        with honest():
            final: Bits = yield Work(self.member.amplified, (int(length), seed))
        return final

    def _prove(self, final: Bits) -> Steps[None]:
        """Keep the key if the leader has the same messages as this host."""
        count = TAG_BYTES * (1 + self.behind)
        heard = yield from hear(Topic.TAGS, NO_BLOCK, count, 255, KEYS_TIMEOUT_S)
        tags = heard.astype(np.uint8).tobytes()
        proof = self.member.tag()
        with honest():
            self.member.check(tags[:TAG_BYTES])
        others: Numbers = np.zeros(0, np.uint32)
        if self.right is not None:
            rest, size = np.frombuffer(tags[TAG_BYTES:], np.uint8), TAG_BYTES * self.behind
            yield from self.right.tell(self.right.side.say(Topic.TAGS, NO_BLOCK, rest, 8))
            others = yield from self.right.hear(Topic.TAGS, NO_BLOCK, size, 255, KEYS_TIMEOUT_S)
        self.ids = key_ids(self.member.terms, final)
        yield Work(self.keys.store, (self.member.terms, final))
        proofs = np.concatenate([np.frombuffer(proof, np.uint8), others])
        yield self.side.say(Topic.TAGS, NO_BLOCK, proofs, 8)
        yield from hear(Topic.KEPT, NO_BLOCK, 0, 0, KEYS_TIMEOUT_S)
        self.kept = True
        self.key_bits = final.size
        yield from self._pass_on(self.side.say(Topic.KEPT, NO_BLOCK, [], 1))

    def _pass_on(self, *reports: Say) -> Steps[None]:
        if self.right is None:
            return
        session = self.right.side.setup.session
        for report in reports:
            messages = tuple(replace(message, session=session) for message in report.messages)
            yield from self.right.tell(Say(messages))
