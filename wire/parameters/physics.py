"""The parameters of devices at the ends of fibres, with unit and range.

The defaults are ideal devices. A topology file names what differs, beside host or link.
"""

import math
from dataclasses import dataclass, field, fields
from functools import cached_property, reduce
from operator import or_
from typing import Any

from wire.features import (
    ABSORB,
    EMIT,
    GATE,
    HERALD,
    INTERFERE,
    MEASURE,
    NOTHING,
    STORE,
    Feature,
    NodeFeatures,
)
from wire.outcomes import BELL_STATES
from wire.parameters.checks import check_choice, check_number

ENCODINGS = ("polarization", "time-bin")
BEAM_SPLITTER = "beam-splitter"
ANALYSERS = ("complete", "linear", "gates", BEAM_SPLITTER)  # kinds of Bell analysers
SCHEMES = ("none", "two-click", "single-click")  # of heralding
MULTIPLEXED, INTERRUPTING, ERROR_RATE = "multiplexed", "interrupting", "error-rate"
RETARDERS = (0, 3, 4)
INTERVALS = (1e-3, 1e9)  # s, between looks of a compensator
REFERENCES = (MULTIPLEXED, INTERRUPTING, ERROR_RATE)  # what a compensator looks at
SUM_TOLERANCE = 1e-9  # by which probabilities may miss 1
# Sources of defaults; 0, infinity, none, and 1 without a unit are ideal and need none.
IDEAL, OURS, PAPER = "ideal", "our choice", "arXiv:1604.01276"


class BadParameter(ValueError):
    """A parameter that cannot be; the message names where, which, its value and its range."""


def parameter(default: Any, least: float, most: float, meaning: str = "", source: str = "") -> Any:
    """Return a field with the range of its values, never NaN, and its default's source."""
    metadata = {"range": (least, most), "meaning": meaning, "source": source}
    return field(default=default, metadata=metadata)


def choice(default: str, *others: str, source: str = "") -> Any:
    return field(default=default, metadata={"choices": (default, *others), "source": source})


def check(where: str, parameters: Any) -> None:
    """Raise BadParameter for a field out of its range; one whose default is None may be None."""
    _check_noise(where, parameters)
    for item in fields(parameters):
        value = getattr(parameters, item.name)
        if value is None and item.default is None:
            continue
        what, metadata = f"{where}: {item.name}", item.metadata
        if "choices" in metadata:
            check_choice(what, value, metadata["choices"], BadParameter)
        if "range" in metadata:
            least, most = metadata["range"]
            check_number(what, value, least, most, BadParameter, metadata["meaning"])


def _check_noise(where: str, parameters: Any) -> None:
    noise, keywords = getattr(parameters, "noise", ""), getattr(parameters, "noise_parameters", {})
    if not isinstance(noise, str) or not isinstance(keywords, dict):
        raise BadParameter(
            f"{where}: noise {noise!r} with noise_parameters {keywords!r}; give FILE.py:CLASS and "
            "a dictionary of keywords"
        )


class Part:
    """A part of a device whose values are each in a range of their own."""

    def check(self, where: str) -> None:
        check(where, self)


@dataclass(frozen=True)
class PairSource:
    """A source of Bell pairs: one pair a pulse and Phi+ by default."""

    # Of the pairs in a pulse; none: the host has no source.
    statistics: str = choice("single", "poisson", "thermal", "none", source=IDEAL)
    mean_pairs: float = parameter(1.0, 0.0, 10.0)  # a pulse, if not single
    fidelity: float = parameter(1.0, 0.25, 1.0)  # Werner: the other Bell states alike
    # Instead of fidelity: the probabilities of Phi+, Psi+, Phi- and Psi-.
    bell_diagonal: tuple[float, ...] | None = None
    jitter_ps: float = parameter(0.0, 0.0, 1e9)  # rms, of the moment of emission
    max_rate_hz: float = parameter(4e9, 1.0, 1e12, source=OURS)  # pulses; more are refused
    encoding: str = choice(*ENCODINGS, source=PAPER)  # of its qubits in light
    bandwidth_nm: float = parameter(0.0, 0.0, 100.0)  # rms of its spectrum, which fibres disperse
    # Of a single source: second-order coherence at no delay. A pulse has two photons with the p of
    # g2 = 2 p / (1 + p)^2, else one.
    g2: float = parameter(0.0, 0.0, 0.49)
    preparation_error: float = parameter(0.0, 0.0, 0.5)  # of a state that the host prepares
    # Two weaker means that its modulator can make for decoy states, of a laser (poisson): weak,
    # vacuum. mean_pairs is the signal's.
    decoys: tuple[float, ...] | None = None
    # Of photons that the host prepares, halves of pairs: a detector of this efficiency looks at the
    # other halves, and what it does not herald is not let out. 0: nothing is heralded.
    heralding_efficiency: float = parameter(0.0, 0.0, 1.0)

    # "path/to/file.py:ClassName" of a noise model of one's own, and keywords for it.
    noise: str = ""
    noise_parameters: dict[str, Any] = field(default_factory=dict)

    def check(self, where: str) -> None:
        check(where, self)
        self._check_decoys(where)
        if self.heralding_efficiency and self.statistics not in ("poisson", "thermal"):
            raise BadParameter(
                f"{where}: heralding_efficiency {self.heralding_efficiency!r} with statistics "
                f"{self.statistics!r}; choose poisson or thermal pairs"
            )
        if self.g2 and self.statistics != "single":
            raise BadParameter(
                f"{where}: g2 {self.g2!r} with statistics {self.statistics!r}, which has its own"
            )
        fractions = self.bell_diagonal
        if fractions is None:
            return
        of_four = isinstance(fractions, tuple) and len(fractions) == len(BELL_STATES)
        valid = of_four and all(map(_is_probability, fractions))
        if not valid or abs(sum(fractions) - 1) > SUM_TOLERANCE:
            raise BadParameter(
                f"{where}: bell_diagonal {fractions!r} is not 4 probabilities that add up to 1"
            )
        if self.fidelity != 1.0:
            raise BadParameter(
                f"{where}: fidelity {self.fidelity!r} and bell_diagonal {fractions!r} are both "
                "given; name one of them"
            )

    def _check_decoys(self, where: str) -> None:
        decoys = self.decoys
        if decoys is None:
            return
        numbers = isinstance(decoys, tuple) and all(isinstance(m, (int, float)) for m in decoys)
        if not numbers or len(decoys) != 2 or not self._can_tell(*decoys):
            raise BadParameter(
                f"{where}: decoys {decoys!r} are not a weak mean and a still weaker one, together "
                f"below mean_pairs {self.mean_pairs!r}"
            )
        if self.statistics != "poisson":
            raise BadParameter(
                f"{where}: decoys with statistics {self.statistics!r}; choose poisson, a laser"
            )
        if self.heralding_efficiency:
            raise BadParameter(f"{where}: decoys with heralding_efficiency, which is of no laser")

    def _can_tell(self, weak: float, vacuum: float) -> bool:
        return 0 <= vacuum < weak and weak + vacuum < self.mean_pairs

    @property
    def intensities(self) -> tuple[float, ...]:
        """Return the mean photon numbers that it can make: the signal's, then those of decoys."""
        return self.mean_pairs, *(self.decoys or ())

    @property
    def multi_photon(self) -> float:
        """How likely a pulse has more than one photon that the host prepares."""
        if self.heralding_efficiency:
            missed = 1 - self.heralding_efficiency
            return self._several(1.0) - self._several(missed)
        if self.statistics == "poisson":
            return -math.expm1(-self.mean_pairs) - self.mean_pairs * math.exp(-self.mean_pairs)
        if self.statistics == "thermal":
            return (self.mean_pairs / (1 + self.mean_pairs)) ** 2
        return (1 - self.g2 - math.sqrt(1 - 2 * self.g2)) / self.g2 if self.g2 else 0.0

    def _several(self, each: float) -> float:
        """Return the sum of P(n) each^n over two and more pairs, of Poisson or thermal ones."""
        mean = self.mean_pairs
        if self.statistics == "poisson":
            return math.exp(-mean) * (math.exp(mean * each) - 1 - mean * each)
        share = mean / (1 + mean)
        return (share * each) ** 2 / (1 - share * each) / (1 + mean)

    def bell_probabilities(self) -> tuple[float, ...]:
        return self.bell_diagonal or (self.fidelity, *[(1 - self.fidelity) / 3] * 3)


@dataclass(frozen=True)
class Memory:
    """A quantum memory or delay line; infinite times: nothing decays."""

    t1_s: float = parameter(float("inf"), 1e-12, float("inf"))
    t2_s: float = parameter(float("inf"), 1e-12, float("inf"))  # at most 2 T1
    # Where T2 > T1: approximate relaxation by Paulis, or follow it in state vectors (small blocks).
    damping: str = choice("twirl", "dense", source=OURS)
    efficiency: float = parameter(1.0, 0.0, 1.0)  # of storing and reading together
    # A plain depolarising memory: with 1 - e^(-t / this) a qubit is replaced by noise.
    depolarizing_s: float = parameter(float("inf"), 1e-12, float("inf"))
    # The efficiency falls by e^(-t/this).
    retrieval_s: float = parameter(float("inf"), 1e-12, float("inf"))
    # Of light that comes: how likely the memory tells of a photon that it has taken in, and of one
    # where none came.
    herald_efficiency: float = parameter(1.0, 0.0, 1.0)
    false_herald: float = parameter(0.0, 0.0, 1.0)
    # An emissive one keeps qubits that emit, or halves of its host's own pairs, but no light that
    # comes from elsewhere.
    kind: str = choice("absorptive", "emissive", source=IDEAL)
    # Older qubits are dropped; a request to store may give another time.
    cutoff_s: float = parameter(float("inf"), 1e-9, float("inf"))
    capacity: int = parameter(4_000_000, 0, 4_000_000, source=OURS)  # qubits

    # "path/to/file.py:ClassName" of a noise model of one's own, and keywords for it.
    noise: str = ""
    noise_parameters: dict[str, Any] = field(default_factory=dict)

    @property
    def heralds_perfectly(self) -> bool:
        """Whether it tells exactly which photons have come."""
        return self.herald_efficiency == 1 and not self.false_herald

    @property
    def keeps(self) -> bool:
        """Whether what has been in it comes out as it was."""
        return self.efficiency == 1 and self.shortest_s == math.inf

    @property
    def shortest_s(self) -> float:
        """The shortest time in which waiting does something."""
        return min(self.t1_s, self.t2_s, self.depolarizing_s, self.retrieval_s)

    def check(self, where: str) -> None:
        check(where, self)
        if self.t2_s > 2 * self.t1_s:
            raise BadParameter(
                f"{where}: t2_s {self.t2_s!r}: choose 1e-12 to {2 * self.t1_s:g} (twice t1_s)"
            )
        if self.depolarizing_s < math.inf and self.t1_s < math.inf:
            raise BadParameter(
                f"{where}: depolarizing_s {self.depolarizing_s!r} beside t1_s {self.t1_s!r}: noise "
                "of both at a time is not modelled; leave one of them out"
            )


# Settings of a memory that can change while a network stands.
ADJUSTABLE = "t1_s", "t2_s", "depolarizing_s", "retrieval_s", "efficiency", "cutoff_s"


@dataclass(frozen=True)
class Gates(Part):
    """A host's gates on the qubits that it holds, and how good they are.

    Depolarising of p leaves X, Y and Z with p/4 each, as in fibres; of two qubits each of the 15
    products of Pauli operators with p/16. The mean gate fidelity is 1 - p/2, and 1 - 3p/4.
    """

    # any: all gates, also between two qubits; paulis: modulators, which do Pauli operators alone.
    kind: str = choice("any", "paulis", source=IDEAL)
    one_qubit_depolarizing: float = parameter(0.0, 0.0, 1.0)  # by each gate but the identity
    two_qubit_depolarizing: float = parameter(0.0, 0.0, 1.0)
    # How long it takes, for all qubits of a block at a time; the others decohere meanwhile.
    one_qubit_s: float = parameter(0.0, 0.0, 10.0)
    two_qubit_s: float = parameter(0.0, 0.0, 10.0)
    initialization_s: float = parameter(0.0, 0.0, 10.0)  # of a qubit that is made in |0>
    readout_s: float = parameter(0.0, 0.0, 10.0)  # of qubits that are kept here, not of light
    initialization_error: float = parameter(0.0, 0.0, 0.5)  # it is in |1>
    readout_error: float = parameter(0.0, 0.0, 0.5)  # the reported outcome is wrong

    # "path/to/file.py:ClassName" of a noise model of one's own, and keywords for it.
    noise: str = ""
    noise_parameters: dict[str, Any] = field(default_factory=dict)

    @property
    def take_time(self) -> bool:
        return any((self.one_qubit_s, self.two_qubit_s, self.initialization_s, self.readout_s))


@dataclass(frozen=True)
class Detectors(Part):
    """The single-photon detectors of a host, all alike, one for each outcome."""

    efficiency: float = parameter(1.0, 0.0, 1.0)
    dark_count_hz: float = parameter(0.0, 0.0, 1e9)
    gate_s: float = parameter(1e-9, 0.0, 1e-3, source=OURS)  # how long it looks for one photon
    dead_time_s: float = parameter(0.0, 0.0, 1.0)  # not extended by light that comes meanwhile
    afterpulse_probability: float = parameter(0.0, 0.0, 1.0)  # of a click, once
    afterpulse_s: float = parameter(1e-7, 1e-12, 1.0, source=OURS)  # mean delay, exponential
    jitter_ps: float = parameter(0.0, 0.0, 1e9)  # rms
    encoding: str = choice(*ENCODINGS, source=PAPER)  # of qubits that they, or analysers, measure
    efficiency_mismatch: float = parameter(0.0, 0.0, 1.0)  # that of 1 has so much less of it
    readout_error: float = parameter(0.0, 0.0, 0.5)  # of light: the reported bit is the other one
    # Of the host's clock, by which clicks are tagged: ahead by this at the start, faster by, rms.
    clock_offset_s: float = parameter(0.0, -1e3, 1e3)
    clock_skew_ppm: float = parameter(0.0, -1e3, 1e3)
    clock_jitter_ps: float = parameter(0.0, 0.0, 1e9)

    # "path/to/file.py:ClassName" of a noise model of one's own, and keywords for it.
    noise: str = ""
    noise_parameters: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class BellAnalyser(Part):
    """How a host makes Bell measurements."""

    # complete (hyperentangled): 4 outcomes; linear (optics): Phi+ and Phi- are one outcome,
    # which is reported as Phi+; gates: CX and H of the host's own, then both are measured, so that
    # there are 4 outcomes, nothing interferes, and the rest of this part does not matter;
    # beam-splitter: one, with four detectors behind it, which tell Psi+ and Psi- alone: all photons
    # of both pulses interfere, as those of lasers do.
    kind: str = choice(*ANALYSERS, source="arXiv:1609.00713")
    visibility: float = parameter(1.0, 0.0, 1.0)  # V0: of Hong-Ou-Mandel interference at best
    # Of a filter, rms of the spectral intensity; 0: none, photons are as wide as their sources say.
    bandwidth_rad_per_s: float = parameter(0.0, 0.0, 1e15)
    coincidence_window_s: float = parameter(1e-6, 1e-12, 1.0, source=OURS)
    # The delay line in which light waits whose way was the shorter, where it matters: the longest
    # that there is, 0 without any, and its loss.
    delay_line_km: float = parameter(2_000.0, 0.0, 20_000.0, source=OURS)
    delay_line_db_per_km: float = parameter(0.2, 0.0, 1_000.0, source="ITU-T G.652.D")


@dataclass(frozen=True)
class Emitter(Part):
    """The optical interface of a memory whose qubits emit photons that are entangled with them.

    Each attempt prepares a qubit and lets it emit; a station between two such hosts heralds.
    """

    # two-click: each qubit emits a photon in one of two modes (Barrett, Kok, Phys. Rev. A 71,
    # 060310); single-click: it does so or not (Cabrillo et al., Phys. Rev. A 59, 1025).
    scheme: str = choice(*SCHEMES)
    efficiency: float = parameter(1.0, 0.0, 1.0)  # of an attempt: its photon is in the fibre
    bright_state: float = parameter(0.05, 0.0, 1.0, source=OURS)  # chance to emit (single-click)
    fidelity: float = parameter(1.0, 0.25, 1.0)  # of qubit and photon; the other Bell states alike
    phase_rad: float = parameter(0.0, 0.0, 10.0)  # single-click: rms error of the light's phase
    preparation_s: float = parameter(0.0, 0.0, 10.0)  # of the qubits, before each attempt
    modes: int = parameter(1, 1, 1_000_000)  # qubits that attempt at the same time


@dataclass(frozen=True)
class Sensor(Part):
    """A quantity that a host's qubits can be exposed to: each takes a phase, unknown to all."""

    phase_rad: float = parameter(0.0, -1e3, 1e3)  # of |1> beside |0>, each time


@dataclass(frozen=True)
class Compensator:
    """An electronic polarisation controller at the ports of a node, and its reference light.

    Retarders about Z, X, Z (and X) of the Poincare sphere undo the turn that the reference showed
    at the last look.
    """

    retarders: int = parameter(0, 0, 4)  # none, 3 or 4
    range_rad: float = parameter(2 * math.pi, 0.0, 1e3, source="three make any turn")
    speed_rad_per_s: float = parameter(float("inf"), 1e-6, float("inf"))  # of each retardance
    insertion_loss_db: float = parameter(0.0, 0.0, 100.0)  # of all light that enters the host
    error_rad: float = parameter(0.0, 0.0, 10.0)  # rms turn that a look is wrong by
    every_s: float = parameter(60.0, *INTERVALS, source=OURS)  # between looks, unless set elsewhere
    # multiplexed: a share of the pulses is reference light, and data goes on;
    # interrupting: light is lost while the reference is measured and the retarders move;
    # error-rate: the data itself, light of which is lost likewise, if too much of it is wrong.
    reference: str = choice(*REFERENCES, source=OURS)
    reference_share: float = parameter(0.0, 0.0, 1.0)  # of the pulses, if it is multiplexed
    measuring_s: float = parameter(0.0, 0.0, 1e6)  # of a look, before the retarders move
    error_limit: float = parameter(0.0, 0.0, 1.0)  # of error-rate: up to it nothing moves

    @property
    def loss_db(self) -> float:
        """Loss of data light: infinite if all pulses are reference light."""
        share = self.reference_share
        return self.insertion_loss_db - (10 * math.log10(1 - share) if share < 1 else -math.inf)

    def check(self, where: str) -> None:
        check(where, self)
        if self.retarders not in RETARDERS:
            raise BadParameter(f"{where}: retarders {self.retarders!r}: choose 0, 3 or 4")
        if self.reference != MULTIPLEXED and self.reference_share:
            raise BadParameter(
                f"{where}: reference_share {self.reference_share!r} with the reference "
                f"{self.reference!r}; choose a multiplexed one, or give measuring_s"
            )


@dataclass(frozen=True)
class Device:
    """The quantum hardware of one host."""

    source: PairSource = PairSource()
    memory: Memory = Memory()
    detectors: Detectors = Detectors()
    analyser: BellAnalyser = BellAnalyser()
    gates: Gates = Gates()
    emitter: Emitter = Emitter()
    sensor: Sensor = Sensor()
    compensator: Compensator = Compensator()

    @cached_property
    def features(self) -> Feature:
        """Return what a host with this device can do; it follows from the parts alone."""
        there = {
            EMIT: self.source.statistics != "none",
            STORE: self.memory.capacity > 0,
            ABSORB: self.memory.capacity > 0 and self.memory.kind == "absorptive",
            GATE: self.gates.kind == "any",
            MEASURE: self.detectors.efficiency > 0,
            HERALD: self.emitter.scheme != "none" and self.memory.capacity > 0,
            INTERFERE: self.detectors.efficiency > 0 and self.analyser.kind != "gates",
        }
        return reduce(or_, (feature for feature, has in there.items() if has), NOTHING)

    @property
    def noises(self) -> dict[str, tuple[str, dict[str, Any]]]:
        """Return the noise models of one's own by the parts that have them, with their keywords."""
        parts = {item.name: getattr(self, item.name) for item in fields(self)}
        named = {name: getattr(part, "noise", "") for name, part in parts.items()}
        return {
            name: (noise, parts[name].noise_parameters) for name, noise in named.items() if noise
        }

    @property
    def node_features(self) -> NodeFeatures:
        return NodeFeatures(self.features, self.memory.capacity)

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Return what of it is not ideal, part by part."""
        parts = {}
        for part in fields(self):
            values, ideal = vars(getattr(self, part.name)), vars(part.default)
            parts[part.name] = {
                name: values[name] for name in values if values[name] != ideal[name]
            }
        return {name: values for name, values in parts.items() if values}

    def check(self, where: str) -> None:
        """Raise BadParameter if a value is out of range."""
        for part in fields(self):
            value: Any = getattr(self, part.name)
            kind: type[Any] = type(part.default)
            if not isinstance(value, kind):
                raise BadParameter(f"{where}: {part.name} {value!r} is not a {kind.__name__}")
            value.check(f"{where}, {part.name}")
        if self.analyser.kind == "gates" and GATE not in self.features:
            raise BadParameter(
                f"{where}, analyser: kind 'gates' with gates of kind {self.gates.kind!r}; choose "
                "gates of kind 'any', or another analyser"
            )


def _is_probability(value: object) -> bool:
    return isinstance(value, (int, float)) and not math.isnan(value) and 0 <= value <= 1
