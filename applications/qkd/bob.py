"""The end that announces what it detected, and corrects its key by asking alice about hers.

    OPENING    -> Proposal
    SIFTING    Detections ->, -> Sifted      for each block; then -> Sample, Disclosed ->
               (with Intensities before both, if there are decoys at these ends)
    RECONCILING AskBlocks, AskIntervals or AskSyndrome ->, -> Parities      many times
               Verify ->
    CONFIRMING -> Amplify, Confirm ->

Messages to alice are on the left of an arrow, those of hers on the right.
"""

from collections import deque

import numpy as np

from applications.qkd.amplification import seed_bits, toeplitz
from applications.qkd.authentication import HASH_KEY_BYTES, key_tag
from applications.qkd.bits import Bits, pack, pack_levels, unpack, unpack_levels
from applications.qkd.cascade import Cascade
from applications.qkd.decoy import Decoys
from applications.qkd.end import End, SessionFailed, State, Terms, out_of_place
from applications.qkd.ldpc_decoding import LdpcDecoding
from applications.qkd.messages import (
    MAX_PHOTONS,
    AbortReason,
    Amplify,
    BellAnswer,
    BellTest,
    Confirm,
    Detections,
    Disclosed,
    Intensities,
    Parities,
    Proposal,
    QkdMessage,
    Reconciliation,
    Sample,
    Sifted,
    Verify,
)
from applications.qkd.parities import Intervals, Query, to_message
from applications.qkd.sifting import Announced
from wire import gaps


class Bob(End):
    """Call `add_block` for each block of light, in its order; alice decides when it is enough."""

    def __init__(self, terms: Terms, decoys: Decoys | None = None) -> None:
        """Begin; decoys: of pulses that he sends to a relay himself."""
        super().__init__(terms)
        self._bobs_decoys = decoys
        self._records: deque[Announced] = deque()
        self._blocks = 0  # announced
        self._answered = -1  # block, of whose tests alice has reported
        self._asked_halves = False
        self.state = State.OPENING

    def add_block(self, record: Announced) -> list[bytes]:
        if self.state is State.ABORTED:
            return []
        if self.state not in (State.OPENING, State.SIFTING):
            raise ValueError("a block after the end of sifting: open a new session for it")
        if record.has_levels is (self._bobs_decoys is None):
            raise ValueError("levels are for decoys, and decoys need them: give both or none")
        if (record.tests is None) is not (not self._parameters.chsh_fraction):
            raise ValueError("tests are for CHSH, and CHSH needs them: give both or none")
        return self._attempt(lambda: [*self._tests(record), self._announce(record)])

    def is_quick(self, data: bytes) -> bool:
        """Answers about halves of blocks are: they bring the next question."""
        return self.state is State.RECONCILING and self._asked_halves

    def _handle(self, message: QkdMessage) -> list[QkdMessage]:
        match self.state, message:
            case State.OPENING, Proposal():
                return self._agree(message)
            case State.SIFTING, BellAnswer() if self._records:
                return self._count_tests(message)
            case State.SIFTING, Sifted():
                return self._sift(message)
            case State.SIFTING, Intensities():
                return self._learn_levels(message)
            case State.SIFTING, Sample():
                return self._compare(message)
            case State.RECONCILING, Parities():
                return self._ask(unpack(message.bits, message.count))
            case State.CONFIRMING, Amplify():
                return self._amplify(message)
        raise out_of_place(message, self.state)

    def _agree(self, message: Proposal) -> list[QkdMessage]:
        if message != self._parameters.proposal():
            raise SessionFailed(
                AbortReason.PARAMETERS,
                f"alice proposes {message}, bob has {self._parameters.proposal()}",
            )
        self.state = State.SIFTING
        return []

    def _tests(self, record: Announced) -> list[QkdMessage]:
        tests = record.tests
        if tests is None:
            return []
        tested, settings, bits = pack(tests.tested), pack(tests.settings), pack(tests.bits)
        return [BellTest(self._blocks, record.photons, tested, settings, bits)]

    def _count_tests(self, message: BellAnswer) -> list[QkdMessage]:
        tests = self._records[0].tests
        due, count = self._blocks - len(self._records), 0 if tests is None else tests.bits.size
        if tests is None or (message.block, message.tests) != (due, count) or self._answered == due:
            raise SessionFailed(
                AbortReason.PROTOCOL, f"an answer of tests of block {message.block}"
            )
        self._answered = due
        clicked = unpack(message.clicked, count).astype(bool)
        both = int(clicked.sum())
        bases, theirs = unpack(message.bases, both), unpack(message.bits, both)
        self.bell.add(bases, tests.settings[clicked], theirs ^ tests.bits[clicked])
        return []

    def _announce(self, record: Announced) -> Detections:
        self._records.append(record)
        self._blocks += 1
        clicked = record.clicked
        if clicked.size > MAX_PHOTONS:
            raise SessionFailed(
                AbortReason.PROTOCOL,
                f"{clicked.size} photons detected in a block, at most {MAX_PHOTONS}: send smaller "
                "blocks (block_pairs)",
            )
        positions, bases = gaps.encode(clicked), pack(record.of(clicked).bases)
        block = self._blocks - 1
        return Detections(block, record.photons, clicked.size, len(positions), positions, bases)

    def _sift(self, message: Sifted) -> list[QkdMessage]:
        due = self._blocks - len(self._records)
        if not self._records or message.block != due:
            raise SessionFailed(AbortReason.PROTOCOL, f"block {message.block}, not {due}")
        record = self._records.popleft()
        if record.tests is not None and self._answered != due:
            raise SessionFailed(AbortReason.PROTOCOL, f"block {due} without an answer of its tests")
        clicked = record.clicked
        if message.clicks != clicked.size:
            text = f"{message.clicks} clicks, not {clicked.size}"
            raise SessionFailed(AbortReason.PROTOCOL, text)
        kept = unpack(message.kept, clicked.size).view(np.bool_)
        sifted = record.of(clicked).of(np.flatnonzero(kept))
        self._keep(sifted, record.photons, clicked.size)
        if sifted.levels is not None:
            self._bobs_levels = np.append(self._bobs_levels, sifted.levels)
        return []

    def _learn_levels(self, message: Intensities) -> list[QkdMessage]:
        if self._records or message.count != self.sifted_bits:
            raise SessionFailed(
                AbortReason.PROTOCOL, f"{message.count} intensities, not {self.sifted_bits}"
            )
        if self._relayed and self._bobs_decoys is None:
            raise SessionFailed(
                AbortReason.PARAMETERS, "alice's source has decoys, and bob's has none"
            )
        self.decoys = Decoys.of(message)
        self._levels = unpack_levels(message.levels, message.count)
        return []

    def _compare(self, message: Sample) -> list[QkdMessage]:
        whole = self._whole()
        size = self._sample_size()
        if self._records or (message.sifted, message.size) != (whole.size, size):
            raise SessionFailed(
                AbortReason.PROTOCOL,
                f"a sample of {message.size} of {message.sifted} bits, not {size} of {whole.size}",
            )
        self._judge_bell()
        if self._bobs_decoys is not None and self.decoys is None:
            raise SessionFailed(
                AbortReason.PARAMETERS, "bob's source has decoys, and alice's has none"
            )
        mask = self._sample_of(message.seed)
        self._raw = whole[~mask]
        disclosures: list[QkdMessage] = [Disclosed(size, pack(whole[mask]))]
        if self._bobs_decoys is not None:
            levels = pack_levels(self._bobs_levels)
            disclosures.insert(0, self._bobs_decoys.message(whole.size, levels))
        self._judge(self._estimate_of(unpack(message.bits, size), whole[mask]), *disclosures)
        return [*disclosures, *self._begin(message.seed)]

    def _begin(self, seed: bytes) -> list[QkdMessage]:
        assert self.estimate
        self._corrector: Cascade | LdpcDecoding
        if self._parameters.reconciliation is Reconciliation.LDPC:
            self._corrector = LdpcDecoding(self._raw, seed, self.estimate)
        else:
            self._corrector = Cascade(self._raw, seed, self.estimate.qber)
        self._questions = self._corrector.questions()
        self.state = State.RECONCILING
        return [self._question(next(self._questions))]

    def _question(self, query: Query) -> QkdMessage:
        self._asked_halves = isinstance(query, Intervals)
        return to_message(query)

    def _ask(self, answer: Bits) -> list[QkdMessage]:
        try:
            return [self._question(self._questions.send(answer))]
        except StopIteration:
            return [self._verify()]

    def _verify(self) -> Verify:
        corrected = self._corrector.result
        self._raw, self._errors = corrected.key, corrected.errors
        self._leaked = corrected.leaked_bits
        self.state = State.CONFIRMING
        hash_key = self._random_bytes(HASH_KEY_BYTES)
        return Verify(hash_key, key_tag(self._raw, hash_key), self._leaked, self._errors)

    def _amplify(self, message: Amplify) -> list[QkdMessage]:
        length = self._key_length(self._leaked)
        count = seed_bits(self._raw.size)
        if (message.length, message.count) != (length, count):
            raise SessionFailed(
                AbortReason.PROTOCOL,
                f"a key of {message.length} bits by a seed of {message.count}, "
                f"not {length} by {count}",
            )
        self.key = toeplitz(self._raw, unpack(message.seed, count), length)
        self.state = State.DONE
        return [Confirm(length)]
