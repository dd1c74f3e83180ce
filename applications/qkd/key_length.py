"""The number of secret bits in a corrected key.

Finite keys: Tomamichel, Lim, Gisin, Renner, "Tight finite-key analysis for quantum
cryptography", Nature Communications 3, 634 (2012), arXiv:1103.4130, equation 2, for ideal
preparation (q = 1), but for the error rate of the key: where that is less than Serfling's bound of
the tail, that of Hoeffding (J. Am. Stat. Assoc. 58, 13 (1963), theorems 1 and 4) takes its place,
with the same probability of failure. The bound is for a sample drawn at random and bases drawn
uniformly and independently for every photon (Tomamichel and Leverrier, Quantum 1, 14 (2017)); other
distributions of bases are not covered. The observed error rate takes the place of the tolerated
one (variable length: Tupkary, Tan, Luetkenhaus, Phys. Rev. Research 6, 023002, 2024).

Pulses of several photons, whose number nobody knows: Gottesman, Lo, Luetkenhaus, Preskill,
Quantum Information and Computation 4, 325 (2004). An eavesdropper may keep one photon of each, let
all of them arrive, and suppress others in their place: as many bits count as known to her as there
were such pulses in the right basis, and all errors as those of the other bits.
"""

from math import floor, inf, log, log2, sqrt

BISECTIONS = 60  # of an interval of 1: as fine as numbers are
ZERO_RATE_QBER = 0.1100  # 1 - 2 h(Q) is zero here (Shor and Preskill 2000)


def binary_entropy(p: float) -> float:
    """Return h(p) in bits; 1 beyond one half, where an error rate tells nothing more."""
    if not 0 <= p <= 1:
        raise ValueError(f"a probability is 0 to 1, not {p}")
    if p >= 0.5:
        return 1.0
    return -p * log2(p) - (1 - p) * log2(1 - p) if p else 0.0


def secret_share(qber: float, single: float = 1.0) -> float:
    """Return W (1 - h(Q / W)), of which error correction is yet to be taken; W are single photons.

    W is a share of the bits, 1 if the source emits no pulse of several photons.
    """
    return single * (1 - binary_entropy(min(1.0, qber / single))) if single > 0 else 0.0


def asymptotic_fraction(qber: float, single: float = 1.0) -> float:
    """Return secret bits per sifted bit of long keys: W (1 - h(Q / W)) - h(Q), at least 0."""
    return max(0.0, secret_share(qber, single) - binary_entropy(qber))


def asymptotic_key_length(key_bits: int, qber: float, leaked_bits: int, single: float = 1.0) -> int:
    """Return n W (1 - h(Q / W)) - leak, at least 0: no security is claimed for a finite key."""
    return max(0, floor(key_bits * secret_share(qber, single) - leaked_bits))


def most_tagged(pulses: int, multi_photon: float, eps: float) -> float:
    """Return how many pulses of several photons were in the right basis at most, but for eps.

    Half of all were; the tail of the binomial distribution is bounded by Bernstein's inequality.
    """
    mean, spread = pulses * multi_photon / 2, log(1 / eps)
    if mean == 0:
        return 0.0
    return mean + spread / 3 + sqrt(spread**2 / 9 + 2 * mean * spread)


def sampling_deviation(key_bits: int, sample_bits: int, eps_sec: float) -> float:
    """Return by how much the key's error rate may exceed the sample's (mu of equation 2)."""
    n, k = key_bits, sample_bits
    return sqrt((n + k) / (n * k) * (k + 1) / k * log(4 / eps_sec))


def most_errors(key_bits: int, sample_bits: int, qber: float, eps_sec: float) -> float:
    """Return the error rate of a key that is exceeded with probability (eps_sec / 4)^2 at most.

    Given that of a sample, which then is q or less of a population with p: exp(-k D(q || p)) bounds
    how likely that is, with the relative entropy D, as it does if bits are put back.
    """
    n, k = key_bits, sample_bits
    least, most = qber, 1.0
    for _ in range(BISECTIONS):
        p = (least + most) / 2
        if k * _relative_entropy(qber, p) < 2 * log(4 / eps_sec):
            least = p
        else:
            most = p
    return min(most + k / n * (most - qber), qber + sampling_deviation(n, k, eps_sec), 1.0)


def _relative_entropy(q: float, p: float) -> float:
    """Return D(q || p) in nats, for q < p."""
    right = (1 - q) * log((1 - q) / (1 - p)) if p < 1 else inf
    return right + (q * log(q / p) if q else 0.0)


def finite_key_length(
    key_bits: int,
    sample_bits: int,
    qber: float,
    leaked_bits: int,
    eps_sec: float,
    eps_cor: float,
    tagged_bits: float = 0.0,
) -> int:
    """Return the length of a key that is eps_sec-secret and eps_cor-correct; 0 if there is none.

    key_bits are the raw bits that are left (n), sample_bits those disclosed (k), qber the error
    rate of the sample, leaked_bits the leak of error correction; tagged_bits are of pulses
    with several photons, at most, and are all taken to be in the key.
    """
    if key_bits < 1 or sample_bits < 1:
        return 0
    errors = most_errors(key_bits, sample_bits, qber, eps_sec)
    secret = key_bits * secret_share(errors, 1 - tagged_bits / key_bits)
    return max(0, floor(secret - leaked_bits - log2(2 / (eps_sec**2 * eps_cor))))
