"""Superdense coding over one fibre: two bits a pair."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from evidence.curves import coding_theory, theory
from evidence.curves.estimates import information, mean, proportion, ratio
from evidence.curves.experiment import Outcome
from evidence.curves.link import PLAIN, TESTED, blocks, is_plain, link
from evidence.curves.parameters import Point
from evidence.laboratory import Laboratory
from hosts.middleware.services.superdense.coding import (
    CODES,
    NAMES,
    Bits,
    Code,
    Mask,
    deinterleave,
    interleave,
)
from wire.outcomes import NO_COINCIDENCE

LOSSES = ("length_km", "loss_db_per_km", "connectors_db")
EFFICIENCY = "detectors_efficiency"
PHASE_NOISE = ("dephasing", "analyser_visibility")
PAULI_NOISE = (
    *("depolarizing", *PHASE_NOISE, "source_fidelity"),
    *("polarization_drift_rad_per_sqrt_km", "polarization_drift_time_s"),
    *("burst_depolarizing", "burst_start_hz", "burst_end_hz"),
)
MEASURES = "bit_error", "dibit_error", "capacity", "arrived", "residual_error"
RATE_HZ = 50_000_000  # as `qmn run` has it


async def run(v: Point, seed: int) -> Outcome:
    """Send random data and count the outcomes."""
    laboratory, random = link(v, seed), np.random.default_rng(seed)
    errors = np.zeros(4, np.int64)  # how often sent XOR received was 0, 1, 2, 3
    wrong: list[tuple[int, int]] = []  # bits of each block after decoding, and all of them
    pairs = 0
    for block, size in blocks(v.pairs):
        message = Message.random(size, str(v["fec"]), v["interleave"] == "on", random)
        received = await transmit(laboratory, block, message.dibits, int(v.rate_hz))
        came = received != NO_COINCIDENCE
        errors += np.bincount((message.dibits ^ received)[came], minlength=4)
        wrong.append(message.wrong_bits(received))
        pairs += size
    wrong_bits, all_bits = zip(*wrong, strict=True)
    return {
        **outcome(errors.tolist(), pairs),
        "residual_error": ratio(wrong_bits, all_bits, message.word_data_bits),
    }


@dataclass(frozen=True)
class Message:
    """Data, and the dibits that it travels as."""

    code: Code
    interleaved: bool
    data: Bits
    dibits: Bits

    @classmethod
    def random(cls, pairs: int, fec: str, interleaved: bool, random: np.random.Generator) -> Self:
        """Return as much data as this many pairs carry; what is left over carries noise."""
        code = CODES[NAMES[fec]]
        data = random.integers(0, 2, data_size(code, 2 * pairs), dtype=np.uint8)
        bits = code.encode(data)
        if interleaved:
            bits = interleave(code, bits, data.size)
        padding = random.integers(0, 2, 2 * pairs - bits.size, dtype=np.uint8)
        high, low = np.concatenate([bits, padding]).reshape(-1, 2).T
        return cls(code, interleaved, data, high << np.uint8(1) | low)

    @property
    def word_data_bits(self) -> int:
        """The data bits of one codeword, which can all go wrong together."""
        return data_size(self.code, self.code.word_bits(self.data.size))

    def wrong_bits(self, received: Bits) -> tuple[int, int]:
        """Return how many data bits are wrong after decoding, and how many there are."""
        size = self.code.encoded_bits(self.data.size)
        pairs = np.stack([received >> np.uint8(1) & np.uint8(1), received & np.uint8(1)], axis=1)
        bits: Bits = pairs.reshape(-1)[:size]
        erased: Mask = np.repeat(received == NO_COINCIDENCE, 2)[:size]
        if self.interleaved:
            bits = deinterleave(self.code, bits, self.data.size)
            erased = deinterleave(self.code, erased, self.data.size)
        decoded = self.code.decode(bits, erased, self.data.size)
        return int(np.count_nonzero(decoded != self.data)), self.data.size


def data_size(code: Code, bits: int) -> int:
    least, most = 1, bits
    while least < most:
        middle = (least + most + 1) // 2
        least, most = (middle, most) if code.encoded_bits(middle) <= bits else (least, middle - 1)
    return least


async def transmit(laboratory: Laboratory, block: int, sent: Bits, rate_hz: int = RATE_HZ) -> Bits:
    """Send a dibit a pair; return what bob sees, 255 where no pair came; shape (k,)."""
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    await alice.create(len(sent), block)
    await alice.apply((block, 0), sent)
    await alice.send({(block, 0): TESTED[0], (block, 1): PLAIN[0]}, rate_hz)
    came = [
        await bob.receive((block, half), port) for half, (_near, port) in enumerate((TESTED, PLAIN))
    ]
    if None in came:
        for half, feedback in enumerate(came):
            if feedback is not None:
                await bob.discard((block, half))
        return np.full(len(sent), NO_COINCIDENCE, np.uint8)
    return await bob.bell_measure((block, 0), (block, 1))


def outcome(errors: Sequence[int], pairs: int) -> Outcome:
    """Return rates from the counts of each dibit error (0: none) in `pairs` pairs."""
    came = sum(errors)
    return {
        # The two bits of a dibit are not independent: it counts as one draw.
        "bit_error": mean((0, 0.5, 0.5, 1), errors),
        "dibit_error": proportion(came - errors[0], came),
        "capacity": information(errors),
        "arrived": proportion(came, pairs),
    }


def loss_db(v: Point) -> float:
    return v.length_km * v.loss_db_per_km + v.connectors_db


def expected(v: Point) -> dict[str, float | None]:
    """Return the theory of each measure, None where more is going on than it knows."""
    figures: dict[str, float | None] = dict.fromkeys(MEASURES)
    p = theory.together(v.depolarizing, theory.of_fidelity(v.source_fidelity))
    if is_plain(v, "depolarizing", *PHASE_NOISE, "source_fidelity", *LOSSES, EFFICIENCY):
        z = theory.either(v.dephasing, (1 - v.analyser_visibility) / 2)
        none, *wrong = likely = theory.pauli_probabilities(p, z)
        figures["bit_error"] = (wrong[0] + wrong[1]) / 2 + wrong[2]
        figures |= {"dibit_error": 1 - none, "capacity": 2 - theory.entropy(likely)}
    if is_plain(v, *PAULI_NOISE, *LOSSES, EFFICIENCY):  # Pauli errors do not matter, detectors do
        figures["arrived"] = theory.transmission(loss_db(v)) * v.detectors_efficiency**2
    if is_plain(v, "depolarizing", "source_fidelity", "length_km"):  # erased bits have none
        interleaved = v["interleave"] == "on"
        figures["residual_error"] = coding_theory.residual_error(str(v["fec"]), interleaved, p)
    return figures
