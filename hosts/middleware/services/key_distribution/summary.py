"""The summary of a key distribution: counts, rates and error rates, never a key."""

from dataclasses import dataclass
from typing import Any
from uuid import UUID

from hosts.middleware.qkd.end import End
from hosts.middleware.qkd.key_length import asymptotic_fraction
from hosts.middleware.qkd.key_store import KEY_BITS

CONFIDENCE = 0.95
DECOYS = "pulses without a fixed phase, whose intensities nobody knows before they are measured"
SOURCES = {
    False: "pulses of one photon or pair at most, or pairs of a source that nobody trusts",
    True: "pulses without a fixed phase; those of several photons are known to an eavesdropper",
}


@dataclass
class Progress:
    """What one end has done so far, beside what its state machine counts."""

    started_s: float  # of the network's clock
    photons: int = 0  # or pairs, that were made
    blocks: int = 0  # of them
    sifted_blocks: int = 0
    light_s: float = 0.0  # until the last of them was sifted

    def note(self, sifted_blocks: int, now_s: float) -> None:
        """Note when blocks have been sifted."""
        if sifted_blocks > self.sifted_blocks:
            self.sifted_blocks, self.light_s = sifted_blocks, now_s - self.started_s


def so_far(progress: Progress, keys: End) -> dict[str, Any]:
    """Return what is told while light is sent."""
    report = keys.report
    return {"photons": progress.photons, "raw_bits": report.raw, "sifted_bits": report.sifted}


def summary(progress: Progress, keys: End, ids: list[UUID], now_s: float) -> dict[str, Any]:
    """Return what is told at the end; None for what is not known.

    Photons, raw and sifted bits are per second of light and sifting, key bits per second of
    the whole session. The limit of the key fraction is that of endless keys.
    """
    report, estimate = keys.report, keys.estimate
    elapsed_s = now_s - progress.started_s
    light_s = progress.light_s or elapsed_s  # nothing was sifted
    low, high = estimate.interval(CONFIDENCE) if estimate else (None, None)
    qber = estimate.qber if estimate else None
    limit = None
    if qber is not None and keys.decoys is None:
        limit = asymptotic_fraction(qber, keys.single_share)
    return {
        **so_far(progress, keys),
        "qber": qber,
        "qber_low": low,
        "qber_high": high,
        "disclosed_bits": report.sample,
        "ones_fraction": estimate.ones / estimate.sample if estimate else None,
        "leaked_bits": report.leaked,
        "key_bits": report.key,
        "key_fraction": report.key / report.sifted if report.sifted else None,
        "key_fraction_limit": limit,
        "multi_photon": keys.multi_photon,
        "single_photon_fraction": keys.single_share if report.sifted else None,
        "assumed": DECOYS if keys.decoys else SOURCES[keys.multi_photon > 0],
        **({"intensities": list(keys.decoys.means)} if keys.decoys else {}),
        **(bell_test(keys) if keys.bell.pairs else {}),
        "keys": len(ids),
        "bits_of_a_key": KEY_BITS,
        "first_key_id": str(ids[0]) if ids else None,
        "last_key_id": str(ids[-1]) if ids else None,
        "authentication_bits": report.authentication,
        "net_key_bits": report.net,
        "light_s": light_s,
        "elapsed_s": elapsed_s,
        "photons_per_s": progress.photons / light_s,
        "raw_bits_per_s": report.raw / light_s,
        "sifted_bits_per_s": report.sifted / light_s,
        "key_bits_per_s": report.key / elapsed_s,
    }


def bell_test(keys: End) -> dict[str, Any]:
    """Return what the CHSH test has told."""
    bell = keys.bell
    return {"chsh": bell.s, "chsh_error": bell.error, "chsh_pairs": bell.pairs}
