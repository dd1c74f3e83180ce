"""Measurements by time tags: the offset of two clocks, g2, and a dip of Hong, Ou, Mandel.

qmn run qkd --protocol bbm92 --seconds 2 --sifted-per-key 20000 --rate-hz 20000000 --tags tags \
    --device charlie.source.statistics=poisson --device charlie.source.mean_pairs=0.005 \
    --device bob.detectors.clock_offset_s=123456ns
python examples/tags.py tags/alice.tags tags/bob.tags
"""

import sys

import numpy as np

UNIT_NS, PULSE_NS = 0.125, 50
ROUGH, FINE, WINDOW = 2048, 1, 16  # units


def read(path):
    """Return times in units of 125 ps, and the detectors of each."""
    high, low = np.fromfile(path, "<u4").reshape(-1, 2).astype(np.int64).T
    return high << 17 | low >> 15, low & 15


def shift(a, b, unit, bins):
    """Return the most frequent delay of b after a, counted in `bins` bins of `unit` each."""
    one, other = (np.fft.rfft(np.bincount(t // unit % bins, minlength=bins)) for t in (a, b))
    found = np.fft.irfft(one.conj() * other, bins).argmax()
    return (int(found) + bins // 2) % bins * unit - bins // 2 * unit


def coincide(a, b, later=0):
    nearest = b[np.minimum(b.searchsorted(a + later - WINDOW), b.size - 1)]
    return np.abs(nearest - a - later) <= WINDOW


def offset(a, b):
    rough = shift(a, b, ROUGH, 1 << 18)
    return rough + shift(a, b - rough, FINE, 1 << 18)


def g2(times, seen, pulse):
    """Return coincidences of outcomes 0 and 1 in a pulse, to those of neighbouring pulses."""
    a, b = times[(seen & 3) > 0], times[(seen & 12) > 0]
    beside = [coincide(a, b, n * pulse).sum() for n in range(-50, 51) if n]
    return coincide(a, b).sum() / np.mean(beside)


def dip(path):
    """Return how often a pair makes the wrong detector of phase click, of a Bell analyser."""
    times, seen = read(path)
    both = coincide(times, times[(seen & 12) > 0]) & ((seen & 3) > 0)
    return (seen[both] & 2 > 0).mean()


if __name__ == "__main__":
    if sys.argv[1] == "dip":
        print(*(f"{path} {dip(path):.4f}" for path in sys.argv[2:]), sep="\n")
    else:
        (a, _), (b, seen) = map(read, sys.argv[1:3])
        print(f"bob is ahead by {offset(a, b) * UNIT_NS} ns")
        print(f"g2 {g2(b, seen, round(PULSE_NS / UNIT_NS)):.2f}")
