"""Two fibres whose turns drift, a compensator, and the error rate that is left, simulated apart."""

from dataclasses import replace
from typing import Any

import numpy as np
import uvloop
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.parameters.physics import Compensator, Detectors, Device, PairSource

COUNT, RATE_HZ, DRIFT_S = 60_000, 10_000, 0.1
PARTS = 20  # of a block, of which each lasts for three drift times
FIBER: dict[str, Any] = {
    "length_km": 1.0,
    "polarization_drift_rad_per_sqrt_km": 0.8,
    "polarization_drift_time_s": DRIFT_S,
}
IDEAL = Compensator(retarders=3)
HOSTS = ("alice", "bob")


def laboratory(
    compensator: Compensator, encoding: str = "polarization", **fiber: Any
) -> Laboratory:
    """Return alice and bob, whom two such fibres join; bob compensates."""
    alice = Device(PairSource(encoding=encoding), detectors=Detectors(encoding=encoding))
    bob = replace(alice, compensator=compensator)
    ends = [[FiberEnd(host, f"{host}-q{i}") for host in ("alice", "bob")] for i in (0, 1)]
    fibers = [Fiber(*way, **FIBER | fiber) for way in ends]
    devices = {"alice": alice, "bob": bob}
    tokens = dict.fromkeys(devices, "")
    return Laboratory(DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices))


async def errors(there: Laboratory, count: int = COUNT, number: int = 0) -> NDArray[np.bool_]:
    """Send photons in Z, X and Y by turns; return which of those that clicked are wrong."""
    states = (np.arange(count) % 6).astype(np.uint8)
    alice, bob = there.host("alice"), there.host("bob")
    await alice.prepare(states, number)
    await alice.send({(number, 0): "alice-q0"}, RATE_HZ)
    await bob.receive((number, 0), "bob-q0")
    bits = await bob.measure((number, 0), bases=states >> np.uint8(1))
    return np.asarray(((bits ^ states) & 1)[bits < 2], bool)


def wrong(compensator: Compensator, **fiber: Any) -> NDArray[np.bool_]:
    return uvloop.run(errors(laboratory(compensator, **fiber)))


def turns(vectors: NDArray[np.float64]) -> Rotation:
    """Compose pieces, shape (n, pieces, 3)."""
    whole = Rotation.identity(len(vectors))
    for piece in np.moveaxis(vectors, 1, 0):
        whole = Rotation.from_rotvec(piece) * whole
    return whole


def expected(
    rms_rad: float,
    every_s: float,
    error_rad: float = 0.0,
    late_s: float = 0.0,
    early_s: float = 0.0,
) -> tuple[float, float]:
    """Simulate the same process and loop apart: return the error rate, and its standard error.

    A photon comes early_s to every_s after its look; if that counts late, after the one before.
    """
    random, count, pieces = np.random.default_rng(7), 100_000, max(int(np.ceil(rms_rad**2)), 1)
    sigma = rms_rad / np.sqrt(3 * pieces)
    ages_s = early_s + random.random(count) * (every_s - early_s)
    ages_s[ages_s < late_s] += every_s
    kept = np.exp(-ages_s / DRIFT_S)[:, None, None]
    looked = random.standard_normal((count, pieces, 3)) * sigma
    now = kept * looked + np.sqrt(1 - kept**2) * random.standard_normal(looked.shape) * sigma
    misread = Rotation.from_rotvec(random.standard_normal((count, 3)) * error_rad / np.sqrt(3))
    left = (misread * turns(looked)).inv() * turns(now)
    each = (1 - np.trace(left.as_matrix(), axis1=1, axis2=2) / 3) / 2
    return float(each.mean()), float(each.std() / np.sqrt(count))


def require(found: NDArray[np.bool_], rate: tuple[float, float]) -> None:
    """Compare an error rate by the spread of parts of the block, which hardly know each other."""
    parts = found.reshape(PARTS, -1).mean(axis=1)
    spread = np.hypot(parts.std(ddof=1) / np.sqrt(PARTS), rate[1])
    assert abs(parts.mean() - rate[0]) < 5 * spread, (parts.mean(), rate, spread)
