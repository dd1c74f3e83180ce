"""The end that announces what it detected, and corrects its key by asking alice about hers.

    OPENING    -> Proposal
    SIFTING    Detections ->, -> Sifted      for each block; then -> Sample, Disclosed ->
    RECONCILING AskBlocks, AskIntervals or AskSyndrome ->, -> Parities      many times
               Verify ->
    CONFIRMING -> Amplify, Confirm ->

What travels to alice is on the left of an arrow, what comes from her on the right.
"""

from collections import deque

from hosts.middleware.qkd.amplification import seed_bits, toeplitz
from hosts.middleware.qkd.bits import Bits, pack, unpack, unpack_levels
from hosts.middleware.qkd.cascade import Cascade
from hosts.middleware.qkd.decoy import Decoys
from hosts.middleware.qkd.end import End, SessionFailed, State, Terms, out_of_place
from hosts.middleware.qkd.estimation import compare
from hosts.middleware.qkd.ldpc_decoding import LdpcDecoding
from hosts.middleware.qkd.questions import to_message
from hosts.middleware.qkd.sifting import Record, sifted
from hosts.middleware.qkd.verification import HASH_KEY_BYTES, key_tag
from wire.qkd import (
    AbortReason,
    Amplify,
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


class Bob(End):
    """Call `add_block` for each block of light, in its order; alice decides when it is enough."""

    def __init__(self, terms: Terms) -> None:
        super().__init__(terms)
        self._records: deque[Record] = deque()
        self._blocks = 0  # announced
        self.state = State.OPENING

    def add_block(self, record: Record) -> list[bytes]:
        """Announce what was detected of the next block."""
        if self.state is State.ABORTED:
            return []
        if self.state not in (State.OPENING, State.SIFTING):
            raise ValueError("a block after the end of sifting: open a new session for it")
        return self._attempt(lambda: [self._announce(record)])

    def _handle(self, message: QkdMessage) -> list[QkdMessage]:
        match self.state, message:
            case State.OPENING, Proposal():
                return self._agree(message)
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

    def _announce(self, record: Record) -> Detections:
        self._records.append(record)
        self._blocks += 1
        clicked = record.clicked
        bases = record.bases[clicked]
        return Detections(self._blocks - 1, record.photons, pack(clicked), pack(bases))

    def _sift(self, message: Sifted) -> list[QkdMessage]:
        due = self._blocks - len(self._records)
        if not self._records or message.block != due:
            raise SessionFailed(AbortReason.PROTOCOL, f"block {message.block}, not {due}")
        record = self._records.popleft()
        clicks = int(record.clicked.sum())
        if message.clicks != clicks:
            raise SessionFailed(AbortReason.PROTOCOL, f"{message.clicks} clicks, not {clicks}")
        kept = unpack(message.kept, clicks).astype(bool)
        bits, bases = sifted(record, record.clicked, kept), record.bases[record.clicked][kept]
        self._add_sifted(bits, bases, clicks, record.photons)
        return []

    def _learn_levels(self, message: Intensities) -> list[QkdMessage]:
        if self._records or message.count != self.sifted_bits:
            raise SessionFailed(
                AbortReason.PROTOCOL, f"{message.count} intensities, not {self.sifted_bits}"
            )
        self._decoys = Decoys.told(message)
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
        mask = self._sample_of(size, message.seed)
        self._raw = whole[~mask]
        disclosed = Disclosed(size, pack(whole[mask]))
        theirs = unpack(message.bits, size)
        self._count_levels(whole[mask], theirs)
        self._judge(compare(theirs, whole[mask]), disclosed)
        return [disclosed, *self._begin(message.seed)]

    def _begin(self, seed: bytes) -> list[QkdMessage]:
        assert self._estimate
        self._corrector: Cascade | LdpcDecoding
        if self._parameters.reconciliation is Reconciliation.LDPC:
            self._corrector = LdpcDecoding(self._raw, seed, self._estimate)
        else:
            self._corrector = Cascade(self._raw, seed, self._estimate.qber)
        self._questions = self._corrector.questions()
        self.state = State.RECONCILING
        return [to_message(next(self._questions))]

    def _ask(self, answer: Bits) -> list[QkdMessage]:
        try:
            return [to_message(self._questions.send(answer))]
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
        count = seed_bits(self._raw.size, length)
        if (message.length, message.count) != (length, count):
            raise SessionFailed(
                AbortReason.PROTOCOL,
                f"a key of {message.length} bits by a seed of {message.count}, "
                f"not {length} by {count}",
            )
        self.key = toeplitz(self._raw, unpack(message.seed, count), length)
        self.state = State.DONE
        return [Confirm(length)]
