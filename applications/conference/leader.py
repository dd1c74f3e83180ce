"""The host that asks for a conference key: it says what states are for, and its bits count."""

from dataclasses import dataclass, field
from typing import Any
from uuid import UUID

import numpy as np

from applications.conference.protocol import (
    IN_BASIS,
    NO_BLOCK,
    ConferenceOptions,
    Keys,
    envelope,
    honest,
    key_ids,
    tags_of,
)
from applications.conference.service import ConferenceFigures
from applications.ghz import line
from applications.key_distribution.options import BOUNDS
from applications.qkd import conference
from applications.qkd.amplification import seed_bits
from applications.qkd.authentication import HASH_KEY_BYTES, TAG_BYTES
from applications.qkd.bits import Bits, unpack
from applications.qkd.conference import KEY, TEST_X, TEST_Z
from applications.qkd.conference_proposal import ConferenceProposal
from applications.qkd.key_store import KEY_BITS
from applications.qkd.messages import Bound
from applications.timeouts import KEYS_TIMEOUT_S
from hosts.hardware.qnic import Qnic
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Now, Steps, Tell, Work, do
from hosts.timeouts import BITS_TIMEOUT_S
from wire.metadata.values import Topic
from wire.metadata.vocabulary import Reason

MEANING = {
    Bound.FINITE: "secret but for eps_sec, for hosts of the line that all are honest and detectors "
    "that miss as much in X as in Z",
    Bound.ASYMPTOTIC: "of endless keys: of a key of this length nothing is proven",
}


def summary(
    key: conference.Leader, length: int, ids: list[UUID], elapsed_s: float, made: int, emitted: int
) -> ConferenceFigures:
    raw, others = key.raw.size, len(key.terms.names) - 1
    authentication = key.consumed_bits
    return ConferenceFigures(
        states=key.states,
        hosts=1 + others,
        raw_bits=raw,
        tests_in_x=key.in_x.sample,
        qber_x=key.in_x.qber,
        tests_in_z=key.worst.sample,
        qber_z=[test.qber for test in key.in_z],
        leaked_bits=key.leaked_bits,
        key_bits=length,
        key_fraction=length / raw,
        key_fraction_limit=conference.asymptotic_rate(key.in_x.qber, key.worst.qber),
        bound=key.terms.bound.name.lower(),
        assumed=MEANING[key.terms.bound],
        keys=len(ids),
        bits_of_a_key=KEY_BITS,
        first_key_id=str(ids[0]) if ids else None,
        last_key_id=str(ids[-1]) if ids else None,
        authentication_bits=authentication,
        net_key_bits=length - authentication,
        states_per_s=key.states / elapsed_s,
        key_bits_per_s=length / elapsed_s,
        elapsed_s=elapsed_s,
        made=made,
        emitted=emitted,
    )


EPS_COR = 1e-15


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
        yield from self.right.tell(envelope(self.right, Topic.PROPOSAL, terms.encode()))
        yield from super().run()
        yield from self._distil()

    @property
    def states(self) -> int:
        return self.key.states

    def figures(self) -> dict[str, Any]:
        """Return nothing more: results of tests come at the end."""
        return {}

    def use(self, number: int, states: int) -> Steps[None]:
        right, fraction = self.right, self.options.test_fraction
        yield from self._see_receipts(number, states)
        drawn = self.side.draws.random(states)
        kinds = np.select([drawn < fraction, drawn < 2 * fraction], [TEST_X, TEST_Z], KEY)
        kinds = kinds.astype(np.uint8)
        shape = len(self.options.names) - 1, states
        theirs = yield from right.ask(Topic.BASES, number, kinds, 2, shape)
        outcomes = line.seen((yield from do(Qnic.measure, right.block(number), IN_BASIS[kinds])))
        with honest():
            mask = self.key.add_block(kinds, outcomes, theirs)
        yield from right.tell(right.side.say(Topic.ARRIVED, number, mask, 1))

    def _see_receipts(self, number: int, states: int) -> Steps[None]:
        size = TAG_BYTES * (len(self.options.names) - 1)
        receipts = yield from self.right.hear(Topic.RECEIPT, number, size, 255, BITS_TIMEOUT_S)
        with honest():
            self.key.check_receipts(number, states, tags_of(receipts))

    def _distil(self) -> Steps[None]:
        key, right, others = self.key, self.right, len(self.options.names) - 1
        self._judge()
        worst, parities = key.worst, (yield Work(key.parities, ()))
        proof = conference.proved(key.raw, self.side.draws.bytes(HASH_KEY_BYTES))
        side = right.side
        yield from right.tell(
            side.say(Topic.COUNTS, NO_BLOCK, [worst.errors, worst.sample], 32),
            side.say(Topic.SYNDROME, NO_BLOCK, parities, 1),
            envelope(right, Topic.HASH, proof),
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
        """Keep the key if all others have the same messages."""
        key, right = self.key, self.right
        tags = key.tags()
        proofs = np.frombuffer(b"".join(tags), np.uint8)
        yield from right.tell(right.side.say(Topic.TAGS, NO_BLOCK, proofs, 8))
        heard = yield from right.hear(Topic.TAGS, NO_BLOCK, proofs.size, 255, KEYS_TIMEOUT_S)
        with honest():
            key.check(tags_of(heard))
        ids, proven = key_ids(key.terms, final), False
        try:
            yield Work(self.keys.store, (key.terms, final))
            yield from right.tell(right.side.say(Topic.KEPT, NO_BLOCK, [], 1))
            proven = True
        finally:
            if not proven:
                self.keys.withdraw(key.terms, ids)
        elapsed_s = (yield Now()) - self.began_s
        yield Tell(summary(key, final.size, ids, elapsed_s, self.made, self.emitted))

    def _judge(self) -> None:
        """Raise SessionError if the measurements leave no key."""
        key, most = self.key, self.options.max_qber
        names = self.options.names[1:]
        tests = {"the parity in X": key.in_x}
        tests |= {f"{name} in Z": test for name, test in zip(names, key.in_z, strict=True)}
        for what, test in tests.items():
            if test.sample and test.qber > most:
                raise SessionError(
                    Reason.TOO_NOISY,
                    f"no key: of {test.sample} tests of {what} {test.errors} are wrong "
                    f"({test.qber:.4f}), at most {most:g}: noise or an eavesdropper",
                )
        if key.length == 0:
            text = f"no secret bit in {key.raw.size} bits of {key.states} states"
            text += f" with an error rate of {key.in_x.qber:.4f} in X" if key.in_x.sample else ""
            raise SessionError(Reason.TOO_NOISY, f"no key: {text}: measure more, or --count more")
