"""Superdense coding over one fibre: two bits a pair."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from dispatcher.laboratory import LaboratoryHost
from evidence.curves import coding_theory, theory
from evidence.curves.estimates import information, mean, proportion, ratio
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import LINK, PLAIN, TESTED, implied, is_plain, link
from evidence.curves.parameters import Parameter, Values
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

BLOCK_PAIRS = 65_536
MIN_BLOCK_PAIRS = 1_024
BATCHES = 64  # that the error of the residual bit error is estimated from, if there are as many
LOSSES = ("length_km", "loss_db_per_km", "connectors_db")
EFFICIENCY = "detectors_efficiency"
PHASE_NOISE = ("dephasing", "analyser_visibility")
PAULI_NOISE = (
    *("depolarizing", *PHASE_NOISE, "source_fidelity"),
    *("polarization_drift_rad_per_sqrt_km", "polarization_drift_time_s"),
    *("burst_depolarizing", "burst_start_hz", "burst_end_hz"),
)
FEC = Parameter("fec", "none", choices=tuple(NAMES))
RATE_HZ = 50_000_000  # as `qmn run` has it
RATE = Parameter("rate_hz", RATE_HZ, 1, 4_000_000_000, "Hz")
INTERLEAVE = Parameter("interleave", "off", choices=("off", "on"))


async def run(values: Values, seed: int) -> Outcome:
    """Send random data and count the outcomes."""
    laboratory = link(values, seed)
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    random = np.random.default_rng(seed)
    errors = np.zeros(4, np.int64)  # how often sent XOR received was 0, 1, 2, 3
    wrong: list[tuple[int, int]] = []  # bits of each block after decoding, and all of them
    sizes = list(blocks(int(values["pairs"])))
    for block, size in enumerate(sizes):
        message = Message.random(size, str(values["fec"]), values["interleave"] == "on", random)
        received = await transmit(alice, bob, block, message.dibits, int(values[RATE.name]))
        came = received != NO_COINCIDENCE
        errors += np.bincount((message.dibits ^ received)[came], minlength=4)
        wrong.append(message.wrong_bits(received))
    wrong_bits, all_bits = zip(*wrong, strict=True)
    return {
        **outcome(errors.tolist(), sum(sizes)),
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


async def transmit(
    alice: LaboratoryHost, bob: LaboratoryHost, block: int, sent: Bits, rate_hz: int = RATE_HZ
) -> Bits:
    """Send a dibit a pair; return what bob sees, 255 where no pair came; shape (k,)."""
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


def blocks(pairs: int) -> Iterator[int]:
    """Yield the sizes of equal blocks that make up a number of pairs, or a few less."""
    size = min(max(pairs // BATCHES, MIN_BLOCK_PAIRS), BLOCK_PAIRS, pairs)
    yield from [size] * (pairs // size)


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


def pauli_probabilities(values: Values) -> tuple[float, ...] | None:
    """Return how likely I, X, Z and XZ are for pairs that arrive, None if more is going on."""
    if not is_plain(values, "depolarizing", *PHASE_NOISE, "source_fidelity", *LOSSES, EFFICIENCY):
        return None
    p = theory.together(number(values, "depolarizing"), source_depolarizing(values))
    indistinct = (1 - number(values, "analyser_visibility")) / 2
    z = theory.either(number(values, "dephasing"), indistinct)
    return theory.pauli_probabilities(p, z)


def source_depolarizing(values: Values) -> float:
    """Return the depolarising that makes pairs as imperfect as the source's."""
    return theory.of_fidelity(number(values, "source_fidelity"))


def bit_error(values: Values) -> float | None:
    likely = pauli_probabilities(values)
    return None if likely is None else (likely[1] + likely[2]) / 2 + likely[3]


def dibit_error(values: Values) -> float | None:
    likely = pauli_probabilities(values)
    return None if likely is None else 1 - likely[0]


def capacity(values: Values) -> float | None:
    likely = pauli_probabilities(values)
    return None if likely is None else 2 - theory.entropy(likely)


def arrived(values: Values) -> float | None:
    """Return the theory of arrived: Pauli errors do not matter, two detectors do."""
    if not is_plain(values, *PAULI_NOISE, *LOSSES, EFFICIENCY):
        return None
    return theory.transmission(loss_db(values)) * number(values, EFFICIENCY) ** 2


def loss_db(values: Values) -> float:
    length_km, loss_db_per_km, connectors_db = (number(values, name) for name in LOSSES)
    return length_km * loss_db_per_km + connectors_db


def residual_error(values: Values) -> float | None:
    """Return the theory of residual_error: depolarising alone, as erased bits have none."""
    if not is_plain(values, "depolarizing", "source_fidelity", "length_km"):
        return None
    p = theory.together(number(values, "depolarizing"), source_depolarizing(values))
    return coding_theory.residual_error(str(values["fec"]), values["interleave"] == "on", p)


SUPERDENSE = Experiment(
    "sdc",
    "superdense coding over one fibre",
    (*LINK, RATE, FEC, INTERLEAVE, pairs_parameter()),
    (
        Measure("bit_error", "bit error", bit_error),
        Measure("dibit_error", "dibit error", dibit_error),
        Measure("capacity", "capacity (bits per pair)", capacity),
        Measure("arrived", "part of the pairs that arrives", arrived),
        Measure("residual_error", "bit error after decoding", residual_error, logarithmic=True),
    ),
    run,
    implied,
)
