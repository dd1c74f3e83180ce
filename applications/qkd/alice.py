"""The end whose key counts as right: she answers questions about it.

    OPENING    Proposal ->
    SIFTING    -> Detections, Sifted ->      for each block; then Sample ->
    ESTIMATING -> Disclosed                  before it Intensities, if both ends have decoys
    RECONCILING -> AskBlocks, AskIntervals or AskSyndrome, Parities ->      many times
               -> Verify, Amplify ->
    CONFIRMING -> Confirm

In BB84 she prepared the light. Bob's messages are on the left of each line.
"""

import hmac
from collections import deque

import numpy as np

from applications.qkd.amplification import seed_bits, toeplitz
from applications.qkd.authentication import key_tag
from applications.qkd.bits import pack, pack_levels, unpack, unpack_levels
from applications.qkd.decoy import Decoys
from applications.qkd.end import End, SessionFailed, State, Terms, out_of_place
from applications.qkd.messages import (
    AbortReason,
    Amplify,
    AskBlocks,
    AskIntervals,
    AskSyndrome,
    BellAnswer,
    BellTest,
    Confirm,
    Detections,
    Disclosed,
    Intensities,
    Parities,
    QkdMessage,
    Sample,
    Sifted,
    Verify,
    kind_of,
)
from applications.qkd.parities import ReferenceKey, to_query
from applications.qkd.public_randomness import SEED_BYTES
from applications.qkd.sifting import Known, choose
from wire.malformed import MalformedPacket
from wire.outcomes import NO_CLICK

MAX_EARLY = 16  # announcements of blocks that have not ended here yet


class Alice(End):
    """Call `start`, `add_block` for each block of light, `distil` when there are enough."""

    _reference: ReferenceKey

    def __init__(self, terms: Terms, decoys: Decoys | None = None) -> None:
        super().__init__(terms)
        self.decoys = decoys
        self._records: deque[Known] = deque()
        self._early: deque[Detections] = deque()
        self._tests: deque[BellTest] = deque()  # likewise
        self._enough = False

    def start(self) -> list[bytes]:
        """Open the session; first call, once."""
        return self._attempt(lambda: [self._parameters.proposal()])

    def add_block(self, record: Known) -> list[bytes]:
        if self.state is State.ABORTED:
            return []
        if record.has_levels is (self.decoys is None):
            raise ValueError("levels are for decoys, and decoys need them: give both or none")
        if self.state is not State.SIFTING or self._enough:
            raise ValueError("a block after distil(): open a new session for it")
        self._records.append(record)
        return self._attempt(self._sift)

    def distil(self) -> list[bytes]:
        """Make a key of all blocks added, as soon as the other end has announced them."""
        if self.state is State.ABORTED:
            return []
        self._enough = True
        return self._attempt(self._sift)

    def is_quick(self, data: bytes) -> bool:
        """Questions about blocks that she has halved before are."""
        return self.state is State.RECONCILING and kind_of(data) == AskIntervals.KIND

    def _handle(self, message: QkdMessage) -> list[QkdMessage]:
        match self.state, message:
            case State.SIFTING, BellTest() if self._parameters.chsh_fraction:
                return self._tested(message)
            case State.SIFTING, Detections():
                return self._announced(message)
            case State.ESTIMATING, Intensities() if self._relayed and self.decoys is not None:
                return self._learn_bobs_levels(message)
            case State.ESTIMATING, Disclosed():
                return self._compare(message)
            case State.RECONCILING, AskBlocks() | AskIntervals() | AskSyndrome():
                parities = self._reference.answer(to_query(message))
                return [Parities(parities.size, pack(parities))]
            case State.RECONCILING, Verify():
                return self._verify(message)
            case State.CONFIRMING, Confirm():
                return self._confirmed(message)
        raise out_of_place(message, self.state)

    def _tested(self, message: BellTest) -> list[QkdMessage]:
        number = self.blocks_sifted + len(self._tests)
        if message.block != number or len(self._tests) > len(self._early):
            raise SessionFailed(AbortReason.PROTOCOL, f"a test of block {message.block}")
        self._tests.append(message)
        return []

    def _announced(self, message: Detections) -> list[QkdMessage]:
        number = self.blocks_sifted + len(self._early)
        if message.block != number or len(self._early) == MAX_EARLY:
            raise SessionFailed(AbortReason.PROTOCOL, f"block {message.block}, not {number}")
        if self._parameters.chsh_fraction and len(self._tests) <= len(self._early):
            raise SessionFailed(AbortReason.PROTOCOL, f"block {number} without a CHSH test")
        self._early.append(message)
        return self._sift()

    def _sift(self) -> list[QkdMessage]:
        """Answer the announcements of blocks that have ended here; go on if that was all."""
        answers: list[QkdMessage] = []
        while self._records and self._early:
            record = self._records.popleft()
            if self._parameters.chsh_fraction:
                answers.append(self._compare_tests(record, self._tests.popleft()))
            answers.append(self._sift_block(record, self._early.popleft()))
        if self._enough and not self._records:
            answers += self._disclose()
        return answers

    def _compare_tests(self, record: Known, message: BellTest) -> BellAnswer:
        if message.photons != record.photons:
            raise SessionFailed(
                AbortReason.PROTOCOL, f"a test of {message.photons} photons, not {record.photons}"
            )
        tested = np.flatnonzero(unpack(message.tested, record.photons))
        count, tests = tested.size, record.of(tested)
        settings, theirs = unpack(message.settings, count), unpack(message.bits, count)
        clicked = tests.outcomes != NO_CLICK
        bases, mine = tests.bases[clicked], tests.outcomes[clicked]
        self.bell.add(bases, settings[clicked], mine ^ theirs[clicked])
        return BellAnswer(message.block, count, pack(clicked), pack(bases), pack(mine))

    def _sift_block(self, record: Known, detections: Detections) -> Sifted:
        if detections.photons != record.photons:
            raise SessionFailed(
                AbortReason.PROTOCOL,
                f"block {detections.block} of {record.photons} photons, {detections.photons} there",
            )
        try:
            clicked, clicks = detections.clicked, detections.clicks
        except MalformedPacket as error:
            raise SessionFailed(AbortReason.MALFORMED, str(error)) from error
        seen = record.of(clicked)
        kept = choose(seen, unpack(detections.bases, clicks))
        sifted = seen.of(np.flatnonzero(kept))
        self._keep(sifted, record.photons, clicks)
        if sifted.levels is not None:
            self._levels = np.append(self._levels, sifted.levels)
        return Sifted(detections.block, clicks, pack(kept))

    def _disclose(self) -> list[QkdMessage]:
        self._judge_bell()
        whole, size = self._whole(), self._sample_size()
        if size == 0:
            raise SessionFailed(AbortReason.TOO_SHORT, f"{whole.size} sifted bits are too few")
        self._seed = self._random_bytes(SEED_BYTES)
        mask = self._sample_of(self._seed)
        self._sample, self._raw = whole[mask], whole[~mask]
        self.state = State.ESTIMATING
        sample = Sample(whole.size, size, self._seed, pack(self._sample))
        if self.decoys is None:
            return [sample]
        levels = pack_levels(self._levels)
        return [
            self.decoys.message(whole.size, levels),
            sample,
        ]

    def _learn_bobs_levels(self, message: Intensities) -> list[QkdMessage]:
        if self._bobs_decoys is not None or message.count != self.sifted_bits:
            raise SessionFailed(
                AbortReason.PROTOCOL, f"{message.count} intensities, not {self.sifted_bits}"
            )
        self._bobs_decoys = Decoys.of(message)
        self._bobs_levels = unpack_levels(message.levels, message.count)
        return []

    def _compare(self, message: Disclosed) -> list[QkdMessage]:
        if message.count != self._sample.size:
            raise SessionFailed(
                AbortReason.PROTOCOL, f"{message.count} test bits, not {self._sample.size}"
            )
        theirs = unpack(message.bits, message.count)
        self._judge(self._estimate_of(self._sample, theirs))
        self._reference = ReferenceKey(self._raw, self._seed)
        self.state = State.RECONCILING
        return []

    def _verify(self, message: Verify) -> list[QkdMessage]:
        self._leaked, self._errors = self._reference.leaked_bits, message.errors
        if message.leaked_bits != self._leaked:
            raise SessionFailed(
                AbortReason.PROTOCOL,
                f"{message.leaked_bits} bits leaked by bob's count, {self._leaked} by alice's",
            )
        if not hmac.compare_digest(key_tag(self._raw, message.hash_key), message.tag):
            raise SessionFailed(
                AbortReason.NOT_CORRECTED, "the corrected keys differ: nothing is delivered"
            )
        length = self._key_length(self._leaked)
        if length == 0:
            raise SessionFailed(AbortReason.TOO_SHORT, self._too_short())
        return [self._amplify(length)]

    def _amplify(self, length: int) -> Amplify:
        count = seed_bits(self._raw.size)
        seed = unpack(self._random_bytes((count + 7) // 8), count)
        self._final = toeplitz(self._raw, seed, length)
        self.state = State.CONFIRMING
        return Amplify(length, count, pack(seed))

    def _confirmed(self, message: Confirm) -> list[QkdMessage]:
        if message.length != self._final.size:
            raise SessionFailed(
                AbortReason.PROTOCOL,
                f"{message.length} bits confirmed, not {self._final.size}",
            )
        self.key = self._final
        self.state = State.DONE
        return []
