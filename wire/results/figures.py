"""The figures of services, as the application at an end receives them and result.json keeps them.

Each service has classes of its own, those of the opener first. A figure without a default is always
present; the others are absent if a session has none, and then read as the default.
None: it is not known. `vars` gives the present ones, in their order.
"""

from dataclasses import dataclass, fields
from typing import Any, cast, dataclass_transform


@dataclass_transform(kw_only_default=True)
class Figures:
    """Nothing, as of an end that has not come to tell anything."""

    def __init_subclass__(cls) -> None:
        dataclass(init=False, repr=False, eq=False)(cls)

    def __init__(self, **values: Any) -> None:
        """Hold the given values; raise TypeError for an unknown name."""
        if unknown := values.keys() - {field.name for field in fields(cast("Any", self))}:
            raise TypeError(f"{type(self).__name__} has no {', '.join(sorted(unknown))}")
        vars(self).update(values)


dataclass(init=False, repr=False, eq=False)(Figures)


class TeleportFigures(Figures):
    """Of teleportation, at both ends."""

    states: int
    arrived: int
    fidelity: float | None
    fidelity_error: float | None  # standard error
    waited_ms: float | None  # in the acceptor's memory, for the bits
    # Of each cardinal state (0, 1, +, -, +i, -i), at the acceptor: how many arrived, and agreed.
    of_states: list[list[int]] | None = None
    elapsed_s: float
    states_per_s: float


class KeyProgress(Figures):
    """Of key distribution, at both ends, while light is sent."""

    photons: int  # or pairs, that were made
    raw_bits: int
    sifted_bits: int
    key_bits: int
    keys: int  # in the store
    qber: float | None = None  # of all keys so far
    qber_low: float | None = None  # of the 95 % confidence interval
    qber_high: float | None = None
    max_qber: float | None = None  # above it there is no key
    newest_qber: list[float] | None = None  # of the newest key, with its 95 % interval
    elapsed_s: float
    handed_out: int = 0  # keys, by --hand-out


class KeyFigures(KeyProgress):
    """Of key distribution, at both ends; counts, rates and error rates, never a key."""

    disclosed_bits: int
    ones_fraction: float | None
    leaked_bits: int
    key_fraction: float | None
    key_fraction_limit: float | None  # that of endless keys
    multi_photon: float
    single_photon_fraction: float | None  # of the sifted bits, at least
    assumed: str
    intensities: list[float] | None = None  # of decoys
    chsh: float | None = None
    chsh_error: float | None = None
    chsh_pairs: int = 0
    bits_of_a_key: int
    first_key_id: str | None
    last_key_id: str | None
    authentication_bits: int
    net_key_bits: int
    light_s: float
    photons_per_s: float  # as raw and sifted bits: of light and sifting
    raw_bits_per_s: float
    sifted_bits_per_s: float
    key_bits_per_s: float  # of the whole session


class MemoryFigures(Figures):
    """Figures of waiting or announced pairs, in some sessions alone."""

    attempts: int = 0  # of heralds
    dropped: int = 0  # pairs, too old
    fidelity_age_s: float | None = None  # since the sample was measured, on average
    fidelity_expected: float | None = None  # now
    sampled_waited_ms: float | None = None
    span_rounds: int = 0  # of purification within a chain
    waited_ms: float | None = None  # for the bits of all swaps
    repeaters_waited_ms: list[float] | None = None  # by their places


class PairFigures(MemoryFigures):
    """Of distribution and swapping, at both ends."""

    session: str
    pairs: int
    pairs_per_s: float
    fidelity: float | None
    fidelity_low: float | None  # of the 95 % confidence interval
    fidelity_high: float | None
    emitted: int
    shared: int
    sampled: int
    rounds: int  # of purification
    compared: int
    survived: int
    elapsed_s: float


class SealFigures(Figures):
    """Of a tamper seal, at its opener."""

    alarm: bool
    preempted: bool  # the light, to a session
    compared: int  # pairs
    emitted: int
    error_rate: float | None
    visibility_z: float | None
    visibility_x: float | None
    tests_whole: int  # that have found nobody
    score: float
    score_of_alarm: float
    false_alarm: float
    missed: float
    light_s: float
    elapsed_s: float
    pairs_per_s: float


class SealedFigures(Figures):
    """Of a tamper seal, at its acceptor."""

    blocks: int
    photons: int


class EveFigures(Figures):
    """An eavesdropper's actions on light, and outcomes."""

    attack: str
    fraction: float  # of the photons
    blocks: int  # that were sent on
    photons: int  # places for photons in them
    lost_blocks: int  # whose light was gone before it could be received
    # Of intercept and resend:
    measured: int = 0
    zeros: int = 0
    ones: int = 0
    # Of photon-number splitting, in pulses:
    expected_db: float = 0.0
    onward_db: float = 0.0
    multi_photon: int = 0
    single_photon: int = 0
    held_back: int = 0
    discarded: int = 0  # photons that were kept, and had to make room


class SenderFigures(Figures):
    """Of superdense coding, at its opener."""

    symbols: int  # Bell states that the receiver's analyser tells apart; 0: not known yet
    bell_pairs: int
    lost_pairs: int
    received_symbols: int
    symbol_errors: int
    corrected_symbols: int  # those of the wrong ones that the code has put right
    filled_symbols: int  # lost ones that the code has filled in
    repeated_frames: int
    delivered_bytes: int
    rate_hz: int  # what the session uses; the controller may have overridden it
    frame_bytes: int
    fec: int  # number of the code; 0: none
    interleave: int  # 1: its codewords are spread over frames
    wavelength_pm: int
    code_rate: float  # bits of data for each bit of code, in all frames so far


class SentFigures(SenderFigures):
    """Of a file that superdense coding carries, at the application that sends it."""

    elapsed_s: float
    pairs_per_s: float
    # Before any code or repetition has put them right; None: no symbol was received.
    symbol_error_rate: float | None


class ReceiverFigures(Figures):
    """Of superdense coding, at its acceptor."""

    bytes: int
    symbols: int
    lost_pairs: int
    symbol_errors: int
    corrected_symbols: int
    filled_symbols: int
    repeated_frames: int
    confusion: list[list[int]]  # symbols sent (row) as they were received (column)


class StoredKeyFigures(Figures):
    """Of key managers: what sessions of theirs have come to."""

    sessions: int
    sessions_without_key: int
    keys: int
    qber_lowest: float | None
    qber_highest: float | None
    elapsed_s: float
    keys_per_s: float


class TunnelFigures(StoredKeyFigures):
    """Of a tunnel with such keys, and the file through it."""

    keys_used: int
    longest_handshake_s: float | None
    tunnel_closed_s: float
    file_bytes: int
    received_bytes: int
    file_intact: bool


class LoadFigures(Figures):
    """Of heavy traffic: the numbers that a person sees first."""

    sessions: int
    accepted: int
    queued: int
    blocked: int
    late: int
    broken: int
    offered_per_s: float | None
    most_at_a_time: int
    carried_erlang: float | None
    setup_p50_s: float | None
    setup_p99_s: float | None
    pairs_per_s: float | None
    fairness: float | None
    controller_ms_a_session: float
