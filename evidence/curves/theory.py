"""Closed forms that measured numbers must agree with.

Depolarising with probability p: X, Y and Z happen with p/4 each. Werner pair of fidelity F:
each of the other three Bell states has probability (1 - F)/3.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from itertools import combinations, product

EXPERIMENT_P = 0.0598  # at which the capacity is that of the experiment below
EXPERIMENT_BITS = (1.665, 0.018)  # per photon, arXiv:1609.00713
SPEED_IN_FIBER_M_PER_S = 2.04e8


def together(*probabilities: float) -> float:
    """Return the depolarising probability of several in a row."""
    return 1 - math.prod(1 - p for p in probabilities)


def of_fidelity(fidelity: float) -> float:
    """Return the depolarising probability that makes a Werner pair of this fidelity."""
    return 4 * (1 - fidelity) / 3


def either(first: float, second: float) -> float:
    """Return how likely one of two independent events happens, but not both."""
    return first * (1 - second) + second * (1 - first)


def pauli_probabilities(p: float, z: float) -> tuple[float, float, float, float]:
    """Return how likely I, X, Z and XZ are after depolarising with p and Z with probability z."""
    none, flipped = (1 - 3 * p / 4) * (1 - z) + p / 4 * z, (1 - 3 * p / 4) * z + p / 4 * (1 - z)
    return none, p / 4, flipped, p / 4


def bit_error(p: float) -> float:
    return p / 2


def dibit_error(p: float) -> float:
    return 3 * p / 4


def capacity(p: float) -> float:
    """Return the capacity of superdense coding in bits a pair: 2 - H(1 - 3p/4, p/4, p/4, p/4)."""
    return 2 - entropy((1 - 3 * p / 4, p / 4, p / 4, p / 4))


def entropy(probabilities: Iterable[float]) -> float:
    """Return the Shannon entropy in bits."""
    return -sum(p * math.log2(p) for p in probabilities if p > 0)


def transmission(loss_db: float) -> float:
    """Return which part of the light comes through an attenuation."""
    return 10 ** (-loss_db / 10)


def teleported_fidelity(fidelity: float) -> float:
    """Return the fidelity of teleportation by a Werner pair, averaged over all states."""
    return (2 * fidelity + 1) / 3


def waited_fidelity(waited_s: float, t1_s: float, t2_s: float, p: float) -> float:
    """Return the fidelity of teleportation, averaged over all states, if a memory keeps one half.

    Both halves together have met depolarising with p; then the memory relaxes with T1 and loses
    coherence with T2 for so long: of a state's direction on the Bloch sphere it keeps e^(-t/T1)
    along Z and e^(-t/T2) across.
    """
    along, across = math.exp(-waited_s / t1_s), math.exp(-waited_s / t2_s)
    return 1 / 2 + (1 - p) * (along + 2 * across) / 6


def agreement_in_x(waits_s: Sequence[tuple[float, float]], t2_s: float) -> float:
    """Return how often X and X of Phi+ agree after both halves of each pair have waited."""
    coherences = [math.exp(-(mine_s + yours_s) / t2_s) for mine_s, yours_s in waits_s]
    return (1 + sum(coherences) / len(coherences)) / 2


def agreement_in_z(waits_s: Sequence[tuple[float, float]], t1_s: float) -> float:
    """Return how often Z and Z of Phi+ agree: both relax from |11>, neither from |00>."""
    unrelaxed = [
        (math.exp(-mine_s / t1_s), math.exp(-yours_s / t1_s)) for mine_s, yours_s in waits_s
    ]
    both = [mine * yours + (1 - mine) * (1 - yours) for mine, yours in unrelaxed]
    return (1 + sum(both) / len(both)) / 2


Detectors = frozenset[tuple[int, int]]  # each by its end and its bit


def several_pairs(
    statistics: str,
    mean_pairs: float,
    arrives: tuple[float, float],
    dark_count: float | tuple[float, float] = 0.0,
    error: float = 0.0,
) -> tuple[float, float]:
    """Return the error rate, and how often both ends see something, of pulses of Phi+ pairs.

    A pair has a fair bit, with `error` another at one end than at the other, and each half arrives
    with its probability; each detector has a dark count with `dark_count`, or with that of its end.
    The probability that no detector of a set clicks is the generating function of the number of
    pairs (of `single`: there is one) at the probability that one pair hits none of them, without
    dark counts; the rest is inclusion and exclusion.
    """
    counts = dark_count if isinstance(dark_count, tuple) else (dark_count, dark_count)

    def dark(detectors: Detectors) -> float:
        none = math.prod(1 - counts[end] for end, _ in detectors)
        misses = _misses(detectors, arrives, error)
        missing = mean_pairs * (1 - misses)
        if statistics == "single":
            return none * misses
        return none * (math.exp(-missing) if statistics == "poisson" else 1 / (1 + missing))

    wrong = both = 0.0
    for mine, yours in product(((0,), (1,), (0, 1)), repeat=2):
        clicking = frozenset([(0, bit) for bit in mine] + [(1, bit) for bit in yours])
        likely = _exactly(clicking, dark)
        both += likely
        certain = len(mine) == len(yours) == 1
        wrong += likely * (float(mine != yours) if certain else 1 / 2)
    return wrong / both, both


def _misses(detectors: Detectors, arrives: tuple[float, float], error: float) -> float:
    """Return the probability that one pair hits none of the detectors."""
    misses = 0.0
    for bit, flip in product((0, 1), (0, 1)):
        outcomes = bit, bit ^ flip
        hits = (arrives[end] * ((end, outcomes[end]) in detectors) for end in (0, 1))
        misses += math.prod(1 - hit for hit in hits) * (error if flip else 1 - error) / 2
    return misses


def _exactly(clicking: Detectors, dark: Callable[[Detectors], float]) -> float:
    rest = frozenset(product((0, 1), (0, 1))) - clicking
    probability = 0.0
    for count in range(len(clicking) + 1):
        for some in combinations(clicking, count):
            probability += (-1.0) ** count * dark(rest | frozenset(some))
    return probability


def scattered_photons(
    length_km: float,
    loss_db_per_km: float,
    classical_mw: float,
    classical_db_per_km: float,
    raman_per_km_nm: float,
    filter_nm: float,
    filter_center_nm: float,
    pulse_window_s: float,
    against: bool = False,
) -> float:
    """Return how many photons classical light scatters into a pulse's window at a fibre's end.

    P rho D (e^(-qL) - e^(-cL))/(c - q) along with the photons, P rho D (1 - e^(-(c + q)L))/(c + q)
    against them, divided by the energy h c / lambda of one.
    """
    signal, light = (db * math.log(10) / 10 for db in (loss_db_per_km, classical_db_per_km))
    left, decay = (
        (1.0, light + signal) if against else (math.exp(-signal * length_km), light - signal)
    )
    far_km = (1 - math.exp(-decay * length_km)) / decay if decay else length_km
    photon_j = 6.62607015e-34 * 299_792_458 / (filter_center_nm * 1e-9)
    scattered_w = classical_mw * 1e-3 * raman_per_km_nm * filter_nm * left * far_km
    return scattered_w * pulse_window_s / photon_j


def coincidence_visibility(
    pairs: float, arrives: tuple[float, float], noises: tuple[float, float]
) -> float:
    """Return (C - A)/(C + A) of pairs of one polarisation, thermal, where few come and click.

    Of the pairs in a pulse either half clicks with a probability, and noise beside it: A are
    accidental coincidences, of different pulses, and C = arrives arrives' (n + n^2) + A.
    """
    accidental = math.prod(
        share * pairs + noise for share, noise in zip(arrives, noises, strict=True)
    )
    of_pairs = math.prod(arrives) * (pairs + pairs**2)
    return of_pairs / (of_pairs + 2 * accidental)


def gain(mean: float) -> float:
    """Return how often a detector sees a pulse with a mean number of photons at it."""
    return -math.expm1(-mean)


def poisson(mean: float, photons: int) -> float:
    """Return how likely a pulse of this mean has a number of photons."""
    return math.exp(-mean) * mean**photons / math.factorial(photons)


def several_photons(mean: float) -> float:
    """Return how likely it has two or more."""
    return 1 - poisson(mean, 0) - poisson(mean, 1)


def sent_on(
    means: Sequence[float], shares: Sequence[float], transmission: float
) -> tuple[float, float]:
    """Return which share of the pulses with one, and with several photons, who splits sends on.

    1 - exp(-mt) of the pulses are to be seen, by first those of several photons.
    """
    pulses = list(zip(means, shares, strict=True))
    clicks = sum(share * gain(mean * transmission) for mean, share in pulses)
    several = sum(share * several_photons(mean) for mean, share in pulses)
    single = sum(share * poisson(mean, 1) for mean, share in pulses)
    return max(0.0, clicks - several) / single, min(1.0, clicks / several)


def no_click(statistics: str, mean: float, seen: float) -> float:
    """Return how likely none of the photons of a pulse is seen, each of which is so likely."""
    return math.exp(-mean * seen) if statistics == "poisson" else 1 / (1 + mean * seen)


def gllp(gain: float, qber: float, single: float) -> float:
    """Return W (1 - h(Q / W)) - h(Q) of the pulses seen, W of which are of one photon at least."""
    if single <= 2 * qber:
        return 0.0
    phase, leak = qber / single, entropy([qber, 1 - qber])
    return gain * max(0.0, single * (1 - entropy([phase, 1 - phase])) - leak)


def key_without_decoys(mean: float, mean_seen: float) -> float:
    """Return secret bits per pulse of BB84 without errors: half the gain that is of single photons.

    All pulses of several photons count as seen, and known to an eavesdropper (quant-ph/0212066).
    """
    return max(0.0, gain(mean_seen) - several_photons(mean)) / 2


def birefringence_error(rms_rad: float) -> float:
    """Return how often a basis is seen wrongly behind n random turns, of this rms altogether.

    Each is by a normal vector with variance v for every component, and leaves
    (1 + 2 (1 - v) e^(-v / 2)) / 3 of a direction on the Bloch sphere. In the limit of many small
    ones the error is (1 - e^(-rms^2 / 3)) / 2.
    """
    turns = max(math.ceil(rms_rad**2), 1)
    v = rms_rad**2 / (3 * turns)
    left = (1 + 2 * (1 - v) * math.exp(-v / 2)) / 3
    return (1 - left**turns) / 2


def within_gate(rms_s: float, gate_s: float) -> float:
    """Return how likely a normal error of this rms is no more than half a gate either way."""
    return math.erf(gate_s / (2 * math.sqrt(2) * rms_s)) if rms_s else 1.0


def swapped_fidelity(first: float, second: float) -> float:
    """Return the fidelity of the pair that swapping makes of two Werner pairs."""
    return first * second + (1 - first) * (1 - second) / 3


def gated_bell_outcomes(p1: float, p2: float) -> tuple[float, float, float, float]:
    """Return how often a CX, an H and two readings tell Phi+, Psi+, Phi- and Psi- of Phi+.

    Depolarising of p2 follows the CX and of p1 the H. After the H, X and Y of its qubit flip the
    bit of the phase (p1/2), Z flips nothing, and the bit of the parity is the other qubit's.
    """
    phase, parity = (1 - p2) * p1 / 2 + p2 / 4, p2 / 4
    return 1 - phase - 2 * parity, parity, phase, parity


def chsh(fidelity: float) -> float:
    """Return S of a Werner pair at the angles that suit Phi+ best: 2 sqrt 2 (4F - 1)/3."""
    return 2 * math.sqrt(2) * (4 * fidelity - 1) / 3


def weak_pulse(mean: float, dark: float, error: float) -> tuple[float, float]:
    """Return how likely a Poisson pulse of this mean at two detectors is seen, and seen wrongly.

    Each photon is wrong with `error`, each detector has a dark count with `dark`; both at once are
    taken at random. To first order dark + error (1 - e^-mean), as in arXiv:1311.7129.
    """
    right, wrong = (1 - (1 - dark) * math.exp(-mean * share) for share in (1 - error, error))
    return right + wrong - right * wrong, wrong - right * wrong / 2


def decoy_key(
    means: Sequence[float],
    shares: Sequence[float],
    seen: Sequence[tuple[float, float]],
    correction: float,
) -> float:
    """Return secret bits a pulse of endless keys with decoys: equations A4 to A6 of 1311.7129.

    Signal, weak and vacuum pulses are seen, and wrong, so likely; bases are chosen evenly, and the
    key is of one of them, a quarter of all pulses.
    """
    m1, m2, m3 = means
    q1, q2, q3 = (math.exp(mean) * gain for mean, (gain, _wrong) in zip(means, seen, strict=True))
    none = max(0.0, (m2 * q3 - m3 * q2) / (m2 - m3))  # yield of pulses without a photon
    single = q2 - q3 - (m2**2 - m3**2) / m1**2 * (q1 - none)
    single *= m1 / (m1 * (m2 - m3) - m2**2 + m3**2)  # yield of one photon
    errors = (math.exp(m2) * seen[1][1] - math.exp(m3) * seen[2][1]) / (m2 - m3)
    tau0 = sum(p * math.exp(-m) for p, m in zip(shares, means, strict=True))
    tau1 = sum(p * m * math.exp(-m) for p, m in zip(shares, means, strict=True))
    gain, wrong = (sum(p * s[i] for p, s in zip(shares, seen, strict=True)) for i in (0, 1))
    secret = tau0 * none + tau1 * single * (1 - entropy([errors / single, 1 - errors / single]))
    return max(0.0, secret - correction * gain * entropy([wrong / gain, 1 - wrong / gain])) / 4


def dependent_loss_error(loss_db: float) -> float:
    """Return the error in any basis by polarisation-dependent loss: (1 - t)^2 / (3 (1 + t^2))."""
    amplitude = 10 ** (-loss_db / 20)
    return (1 - amplitude) ** 2 / (3 * (1 + amplitude**2))


def mode_dispersion_error(mean_s: float, width_rad_per_s: float) -> float:
    """Return the same by a Maxwell-distributed delay: (1 - (1 + pi (s D)^2 / 8)^(-3/2)) / 3."""
    return (1 - math.pow(1 + math.pi * (width_rad_per_s * mean_s) ** 2 / 8, -1.5)) / 3


def rad_per_s(bandwidth_nm: float) -> float:
    """Return an optical bandwidth at 193.4 THz (1550.12 nm) in rad/s: 2 pi f^2 / c for each m."""
    return 2 * math.pi * 193.4e12**2 / 299_792_458 * bandwidth_nm * 1e-9


def coincidences(
    mismatch_s: float, visibility: float, bandwidth_rad_per_s: float, chirp_s2: float = 0.0
) -> float:
    """Return the Hong-Ou-Mandel coincidence probability: 1/2 (1 - V0 exp(-(sigma tau)^2)).

    One photon dispersed by b = `chirp_s2` divides (sigma tau)^2 by 1 + b^2 sigma^4, V0 by its root.
    """
    stretched = 1 + (chirp_s2 * bandwidth_rad_per_s**2) ** 2
    seen = math.exp(-((bandwidth_rad_per_s * mismatch_s) ** 2) / stretched) / math.sqrt(stretched)
    return (1 - visibility * seen) / 2


@cache
def clicks_with_dead_time(click: float, blind: int, pulses: int) -> float:
    """Return the clicks a pulse if each blinds the detector for a number of pulses.

    `click` is the probability of a detector that is awake, as it is when a train of `pulses`
    begins. A pulse clicks if it would and none of the `blind` before it has; after many pulses
    that comes to click / (1 + blind * click).
    """
    chances: list[float] = []
    asleep = 0.0  # the probability that one of the last `blind` pulses has clicked
    for pulse in range(pulses):
        chances.append(click * (1 - asleep))
        asleep += chances[-1]
        if pulse >= blind:
            asleep -= chances[pulse - blind]
    return sum(chances) / pulses


def two_clicks(light: float, visibility: float) -> tuple[float, float]:
    """Return how likely two clicks herald a pair, and its fidelity (Barrett and Kok).

    `light` is how likely a photon of either memory clicks; detectors have no dark counts.
    """
    return light**2 / 2, (1 + visibility) / 2


def single_click(light: float, bright: float, visibility: float) -> tuple[float, float]:
    """Return the same of one click, of memories that emit with this probability.

    Of both photons, one may click, or both may at the same detector: so they do with (1 + V) / 2.
    """
    one = 2 * bright * (1 - bright) * light
    both = bright**2 * (2 * light * (1 - light) + light**2 * (1 + visibility) / 2)
    chance = one + both
    return chance, one * (1 + math.sqrt(visibility)) / 2 / chance


def attempts_until_two(chance: float, rounds: float) -> float:
    """Return how many attempts it takes until two successes within a window.

    A geometric gap is short enough with s = 1 - (1 - p)^m: (1 + 1/s) / p by Wald's identity.
    """
    short = 1 - math.pow(1 - chance, rounds)
    return (1 + 1 / short) / chance


def kept_over_gap(chance: float, rounds: float, step: float) -> float:
    """Return the mean of step^g over geometric gaps g of at most a number of rounds."""
    other = (1 - chance) * step
    short = 1 - math.pow(1 - chance, rounds)
    return chance * step * (1 - math.pow(other, rounds)) / (1 - other) / short


def purified(fidelity: float, gates: float, misread: float) -> tuple[float, float]:
    """Return how good a round of BBPSSW makes Werner pairs, and how often it succeeds.

    Bennett et al., Phys. Rev. Lett. 76, 722, equation 7, with gates that depolarise both qubits of
    an end with probability `gates`, and readings that are wrong with `misread`.
    """
    other, clean = (1 - fidelity) / 3, (1 - gates) ** 2
    # Of the kept pair as Phi+, by whether both ends should read the same of the other one. Where
    # an end depolarises, all 16 Pauli errors of the two pairs are alike.
    good = clean * (fidelity**2 + other**2) + (1 - clean) / 8
    dropped = clean * (fidelity + other) * other + (1 - clean) / 8
    agree = clean * ((fidelity + other) ** 2 + (2 * other) ** 2) + (1 - clean) / 2
    wrong = either(misread, misread)
    success = agree * (1 - wrong) + (1 - agree) * wrong
    return (good * (1 - wrong) + dropped * wrong) / success, success


def gated_swap_fidelity(one: float, two: float, misread: float, coherence: float) -> float:
    """Return the fidelity of perfect pairs joined by a Bell measurement by gates.

    Depolarising of the CX leaves nothing of the outcome, that of the H flips the bit of the phase
    with p/2; each bit is read wrongly so often. The ends keep so much of their coherence meanwhile.
    """
    clean, read = 1 - two, 1 - 2 * misread
    phases = clean * (1 - one) * coherence * read
    return (1 + phases + phases * read + clean * read) / 4
