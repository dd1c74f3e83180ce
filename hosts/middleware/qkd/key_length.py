"""The number of secret bits in a corrected key.

Finite keys: Tomamichel, Lim, Gisin, Renner, "Tight finite-key analysis for quantum
cryptography", Nature Communications 3, 634 (2012), arXiv:1103.4130, equation 2, for ideal
preparation (q = 1). The bound is for a sample drawn at random and bases drawn uniformly and
independently for every photon (Tomamichel and Leverrier, Quantum 1, 14 (2017)); other
distributions of bases are not covered. The observed error rate takes the place of the
tolerated one (variable length: Tupkary, Tan, Luetkenhaus, Phys. Rev. Research 6, 023002, 2024).
"""

from math import floor, log, log2, sqrt

ZERO_RATE_QBER = 0.1100  # 1 - 2 h(Q) is zero here (Shor and Preskill 2000)


def binary_entropy(p: float) -> float:
    """Return h(p) in bits; 1 beyond one half, where an error rate tells nothing more."""
    if not 0 <= p <= 1:
        raise ValueError(f"a probability is 0 to 1, not {p}")
    if p >= 0.5:
        return 1.0
    return -p * log2(p) - (1 - p) * log2(1 - p) if p else 0.0


def asymptotic_fraction(qber: float) -> float:
    """Return secret bits per sifted bit in the limit of long keys: 1 - 2 h(Q), at least 0."""
    return max(0.0, 1 - 2 * binary_entropy(qber))


def asymptotic_key_length(key_bits: int, qber: float, leaked_bits: int) -> int:
    """Return n (1 - h(Q)) - leak, at least 0: no security is claimed for a finite key."""
    return max(0, floor(key_bits * (1 - binary_entropy(qber)) - leaked_bits))


def sampling_deviation(key_bits: int, sample_bits: int, eps_sec: float) -> float:
    """Return by how much the key's error rate may exceed the sample's (mu of equation 2)."""
    n, k = key_bits, sample_bits
    return sqrt((n + k) / (n * k) * (k + 1) / k * log(4 / eps_sec))


def finite_key_length(
    key_bits: int, sample_bits: int, qber: float, leaked_bits: int, eps_sec: float, eps_cor: float
) -> int:
    """Return the length of a key that is eps_sec-secret and eps_cor-correct; 0 if there is none.

    key_bits are the raw bits that are left (n), sample_bits those disclosed (k), qber the error
    rate of the sample, leaked_bits all that error correction has told.
    """
    if key_bits < 1 or sample_bits < 1:
        return 0
    phase_error = min(1.0, qber + sampling_deviation(key_bits, sample_bits, eps_sec))
    secret = key_bits * (1 - binary_entropy(phase_error))
    return max(0, floor(secret - leaked_bits - log2(2 / (eps_sec**2 * eps_cor))))
