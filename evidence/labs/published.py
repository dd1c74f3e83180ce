"""Published figures of papers that no lab is about, for the rows of `qmn lab curves`."""

from functools import partial
from operator import itemgetter

from applications.qkd.key_length import binary_entropy, secret_share
from evidence.curves import theory
from evidence.curves import vacuum_and_weak as decoys
from evidence.curves.estimates import Estimate
from evidence.labs.lab import Published, PublishedRow

# Hensen et al., Nature 526, 682 (2015): two electron spins in diamond, 1.3 km apart.
DELFT, DELFT_ERROR = 0.92, 0.03  # fidelity
# Ma, Qi, Zhao and Lo, Phys. Rev. A 72, 012326 (2005). The paper could not be opened here: these are
# its figures as others' programs quote them. Distances all end in .05 km, so that half of a tenth
# of a kilometre is taken for their error.
MA = "arXiv:quant-ph/0503005"
WEAK_AT_40_KM, WEAK = 0.12, 0.05  # photons a pulse


def threshold() -> Estimate:
    from scipy.optimize import brentq  # takes a second, which few need

    def left(qber: float) -> float:
        return secret_share(qber) - binary_entropy(qber)

    return Estimate(float(brentq(left, 0.01, 0.3)), 0.0)


def beside_endless(number: int, sign: float) -> Estimate:
    """Return in % how far the yield (0) or error (1) of one photon is bounded off, at 40 km."""
    estimated, right = decoys.with_decoys(40, WEAK_AT_40_KM)[number], decoys.endless(40)[number]
    return Estimate(100 * sign * (estimated / right - 1), 0.0)


def reach(weak: float | None) -> Estimate:
    """Return how far decoys bring keys (km)."""
    return Estimate(decoys.reach(weak), 0.0)


PUBLISHED = [
    PublishedRow(
        "doi 10.1038/nature15759",
        f"S of pairs of fidelity {DELFT:g}",
        Published(2.42, 0.20, "abstract"),
        itemgetter("chsh"),
        [("chsh", {"fidelity": DELFT})],
        DELFT_ERROR * (theory.chsh(1.0) - theory.chsh(0.0)),
    ),
    PublishedRow(
        "arXiv:quant-ph/0003004",
        "most errors of a BB84 that leave a key",
        Published(0.11, 0.005, "Shor and Preskill: 11 %"),
        threshold,
    ),
    PublishedRow(
        MA,
        "% less single photons by a weak pulse of 0.12 than there are, 40 km",
        Published(3.5, 0.05, "figure 1"),
        partial(beside_endless, 0, -1.0),
    ),
    PublishedRow(
        MA,
        "% more errors of those than there are",
        Published(16.8, 0.05, "figure 1"),
        partial(beside_endless, 1, 1.0),
    ),
    PublishedRow(
        MA,
        "km of key by 0.48, 0.05 and no photons",
        Published(140.55, 0.05, "figure 2"),
        partial(reach, WEAK),
    ),
    PublishedRow(
        MA,
        "km of key by endlessly many intensities",
        Published(142.05, 0.05, "figure 2"),
        partial(reach, None),
    ),
]
