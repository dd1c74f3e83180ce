"""Parameters of a session that must be alike at both ends."""

from dataclasses import dataclass
from math import floor

from applications.qkd import relayed_decoys
from applications.qkd.authentication import TAG_BITS, collision_probability
from applications.qkd.decoy import Decoys, Sifted, bounds, key_length
from applications.qkd.key_length import (
    ZERO_RATE_QBER,
    asymptotic_key_length,
    finite_key_length,
    most_tagged,
)
from applications.qkd.messages import MAX_KEY_BITS, Bound, Proposal, Reconciliation
from applications.qkd.relayed_decoys import Ends, PairSifted


@dataclass(frozen=True)
class Parameters:
    """How a key is made: all fractions and probabilities lie between 0 and 1.

    A session ends without a key if the error rate of the sample is above max_qber, which
    stays below the 11 % where even an endless key holds no secret bit.
    """

    test_fraction: float = 0.1  # of the sifted bits, disclosed
    max_qber: float = 0.1
    eps_sec: float = 1e-10
    eps_cor: float = 1e-15
    bound: Bound = Bound.FINITE
    reconciliation: Reconciliation = Reconciliation.CASCADE
    multi_photon: float = 0.0  # how likely a pulse of alice's source has several photons
    chsh_fraction: float = 0.0  # of bob's photons, for a CHSH test that decides; 0: there is none
    chsh_margin: float = 0.0  # by which S has to be above 2, if not by five standard errors

    def __post_init__(self) -> None:
        for name in ("test_fraction", "max_qber", "eps_sec", "eps_cor"):
            if not 0 < getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}, not between 0 and 1")
        if not 0 <= self.multi_photon < 1:
            raise ValueError(f"multi_photon is {self.multi_photon}, not 0 to less than 1")
        for name in ("chsh_fraction", "chsh_margin"):
            if not 0 <= getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}, not 0 to less than 1")
        if self.max_qber >= ZERO_RATE_QBER:
            raise ValueError(
                f"max_qber is {self.max_qber}: at {ZERO_RATE_QBER} no key is secret, stay below"
            )
        least = collision_probability(MAX_KEY_BITS)
        if self.eps_cor < least:
            raise ValueError(f"eps_cor is {self.eps_cor}, the hash allows {least:.1e} at least")

    def proposal(self) -> Proposal:
        return Proposal(**vars(self))

    def key_length(
        self, key_bits: int, sample_bits: int, qber: float, leaked_bits: int, pulses: int
    ) -> int:
        """Return the length of the final key; leaked_bits are those of error correction."""
        leaked = leaked_bits + TAG_BITS
        if self.bound is Bound.ASYMPTOTIC:
            single = self.single_share(pulses, key_bits + sample_bits)
            return asymptotic_key_length(key_bits, qber, leaked, single)
        if not self.multi_photon:
            eps, tagged = self.eps_sec, 0.0
        else:  # half of it for the bound of the tags
            eps = self.eps_sec / 2
            tagged = most_tagged(pulses, self.multi_photon, eps)
        return finite_key_length(key_bits, sample_bits, qber, leaked, eps, self.eps_cor, tagged)

    @property
    def eps_of_counts(self) -> float | None:
        """Return eps_sec; None if nothing is bounded."""
        return None if self.bound is Bound.ASYMPTOTIC else self.eps_sec

    def decoy_key_length(self, decoys: Decoys, counts: Sifted, leaked_bits: int) -> int:
        leaked = leaked_bits + TAG_BITS
        if self.bound is Bound.ASYMPTOTIC:
            return max(0, floor(bounds(decoys, counts, None).secret - leaked))
        return key_length(decoys, counts, leaked, self.eps_sec, self.eps_cor)

    def relayed_key_length(self, ends: Ends, counts: PairSifted, leaked_bits: int) -> int:
        leaked = leaked_bits + TAG_BITS
        if self.bound is Bound.ASYMPTOTIC:
            return max(0, floor(relayed_decoys.bounds(ends, counts, None).secret - leaked))
        return relayed_decoys.key_length(ends, counts, leaked, self.eps_sec, self.eps_cor)

    def single_share(self, pulses: int, sifted: int) -> float:
        """Return the share of sifted bits that is of single photons at least, of long keys."""
        return 1 - min(1.0, pulses * self.multi_photon / 2 / sifted) if sifted else 0.0
