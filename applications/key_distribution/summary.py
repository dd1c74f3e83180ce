"""The summary of a key distribution: counts, rates and error rates, never a key."""

from collections.abc import Iterable, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from math import isfinite
from typing import Any
from uuid import UUID

from applications.qkd.bell_test import Correlations
from applications.qkd.end import End
from applications.qkd.key_length import asymptotic_fraction
from applications.qkd.key_store import KEY_BITS
from hosts.middleware.session.estimation import Estimate
from wire.results.figures import KeyFigures, KeyProgress

CONFIDENCE = 0.95
DECOYS = "pulses without a fixed phase, whose intensities nobody knows before they are measured"
SOURCES = {
    False: "pulses of one photon or pair at most, or pairs of a source that nobody trusts",
    True: "pulses without a fixed phase; those of several photons are known to an eavesdropper",
}


@dataclass
class Counts:
    """Totals over the keys of a session; in bits by default."""

    raw: int = 0
    sifted: int = 0
    blocks: int = 0  # of light that are sifted
    estimate: Estimate = field(default_factory=lambda: Estimate(0, 0))
    leaked: int = 0
    key: int = 0
    authentication: int = 0
    single: float = 0.0  # sifted bits of single photons
    multi_photon: float = 0.0
    means: tuple[float, ...] = ()  # of decoys
    bell: Correlations = field(default_factory=Correlations)

    def add(self, keys: End) -> None:
        report, estimate = keys.report, keys.estimate
        self.raw += report.raw
        self.sifted += report.sifted
        self.blocks += keys.blocks_sifted
        self.leaked += report.leaked
        self.key += report.key
        self.authentication += report.authentication
        self.single += keys.single_share * report.sifted
        self.multi_photon = keys.multi_photon
        self.bell.include(keys.bell)
        if estimate is not None:
            self.estimate = self.estimate.beside(estimate)
        if keys.decoys is not None:
            self.means = tuple(keys.decoys.means)

    @property
    def single_share(self) -> float:
        """The share of the sifted bits that single photons have brought at least."""
        return self.single / self.sifted if self.sifted else 0.0


@dataclass
class Progress:
    started_s: float  # of the network's clock
    photons: int = 0  # or pairs, that were made
    blocks: int = 0  # of them
    light_s: float = 0.0  # until the last block was sifted
    made: Counts = field(default_factory=Counts)  # of keys that are made
    keys: int = 0  # of KEY_BITS, in the store
    first_id: str | None = None
    last_id: str | None = None
    max_qber: float = 0.0  # above it there is no key
    newest: Estimate | None = None  # of the key whose error rate was estimated last
    _sifted_blocks: int = 0

    def stored(self, ids: Sequence[UUID]) -> None:
        if ids:
            self.first_id, self.last_id = self.first_id or str(ids[0]), str(ids[-1])
        self.keys += len(ids)

    def note(self, ends: Sequence[End], now_s: float) -> None:
        self.newest = next((e.estimate for e in reversed(ends) if e.estimate), self.newest)
        blocks = self.made.blocks + sum(keys.blocks_sifted for keys in ends)
        if blocks > self._sifted_blocks:
            self._sifted_blocks, self.light_s = blocks, now_s - self.started_s

    def counts(self, ends: Iterable[End]) -> Counts:
        """Return the counts of all keys, also of those under way."""
        counts = deepcopy(self.made)
        for keys in ends:
            counts.add(keys)
        return counts


def so_far(progress: Progress, ends: Iterable[End], now_s: float) -> KeyProgress:
    counts, newest = progress.counts(ends), progress.newest
    qber, low, high = error_rate(counts.estimate)
    return KeyProgress(
        photons=progress.photons,
        raw_bits=counts.raw,
        sifted_bits=counts.sifted,
        key_bits=counts.key,
        keys=progress.keys,
        qber=qber,
        qber_low=low,
        qber_high=high,
        max_qber=progress.max_qber,
        newest_qber=[newest.qber, *newest.interval(CONFIDENCE)] if newest else None,
        elapsed_s=now_s - progress.started_s,
    )


def error_rate(estimate: Estimate) -> tuple[float, float, float] | tuple[None, None, None]:
    """Return the error rate and the ends of its interval; None: no bit was compared."""
    return (
        (estimate.qber, *estimate.interval(CONFIDENCE)) if estimate.sample else (None, None, None)
    )


def summary(progress: Progress, ends: Iterable[End], now_s: float) -> KeyFigures:
    """Return the final report, also of keys that will not be made; None: not known.

    Key bits are per second of the session, all else is per second of light and sifting.
    """
    counts = progress.counts(ends)
    elapsed_s = now_s - progress.started_s
    light_s = progress.light_s or elapsed_s  # nothing was sifted
    qber, low, high = error_rate(counts.estimate)
    return KeyFigures(
        photons=progress.photons,
        raw_bits=counts.raw,
        sifted_bits=counts.sifted,
        qber=qber,
        qber_low=low,
        qber_high=high,
        max_qber=progress.max_qber,
        disclosed_bits=counts.estimate.sample,
        ones_fraction=counts.estimate.ones_fraction,
        leaked_bits=counts.leaked,
        key_bits=counts.key,
        key_fraction=counts.key / counts.sifted if counts.sifted else None,
        key_fraction_limit=fraction_limit(counts),
        multi_photon=counts.multi_photon,
        single_photon_fraction=counts.single_share if counts.sifted else None,
        assumed=DECOYS if counts.means else SOURCES[counts.multi_photon > 0],
        **some_only(counts),
        keys=progress.keys,
        bits_of_a_key=KEY_BITS,
        first_key_id=progress.first_id,
        last_key_id=progress.last_id,
        authentication_bits=counts.authentication,
        net_key_bits=counts.key - counts.authentication,
        light_s=light_s,
        elapsed_s=elapsed_s,
        photons_per_s=progress.photons / light_s,
        raw_bits_per_s=counts.raw / light_s,
        sifted_bits_per_s=counts.sifted / light_s,
        key_bits_per_s=counts.key / elapsed_s,
    )


def fraction_limit(counts: Counts) -> float | None:
    """Return the key fraction of endless keys; None: not known, as with decoys."""
    qber, _low, _high = error_rate(counts.estimate)
    if qber is None or counts.means:
        return None
    return asymptotic_fraction(qber, counts.single_share)


def some_only(counts: Counts) -> dict[str, Any]:
    decoys = {"intensities": list(counts.means)} if counts.means else {}
    bell = counts.bell
    if not bell.pairs:
        return decoys
    s, error = (value if isfinite(value) else None for value in (bell.s, bell.error))
    return {**decoys, "chsh": s, "chsh_error": error, "chsh_pairs": bell.pairs}
