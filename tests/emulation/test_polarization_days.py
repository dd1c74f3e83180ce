"""Hours and days of drifting polarisation in stepped time: with a compensator and without."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from loaded import run_qmn
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

KM, TESTED = 1.0, 2000  # of 20,000 sifted bits a tenth is compared
EXPERIMENTS = 1000  # that are simulated
HOURS = """
import json, re, sys
from hosts.client import blocking_session
from hosts.stack_socket import QuantumSocketError
from qmn.scripting import start

sessions, period_s, options = int(sys.argv[1]), int(sys.argv[2]), json.loads(sys.argv[3])
with start("sdc", time="stepped", **options) as network:
    time, found = network.runtime.time, []
    for number in range(sessions):
        keys = network.runtime.socket, "bb84", ("alice", "bob"), 7, time
        with blocking_session(*keys, limit_s=60, count=20_000) as asked:
            began_s = began_s if number else time.now_s()
            try:
                asked.results()
                asked.end()
                found.append(asked.summary["qber"])
            except QuantumSocketError as error:  # too many errors for a key
                found.append(float(re.search("QBER (?:of )?([0-9.]+)", str(error))[1]))
        network.sleep(began_s + period_s * (number + 0.5) - time.now_s())
print(json.dumps(found))
"""


@dataclass(frozen=True)
class Days:
    """Sessions of BB84 at equal times over two fibres, and how often bob's compensator looks."""

    sessions: int
    period_s: int
    rms_rad: float  # of each fibre
    drift_s: int
    every_s: int | None

    def measured(self, folder: Path) -> list[float]:
        """Return the error rate of each session over the real network; the policy sets every_s."""
        policy = folder / "policy.toml"
        policy.write_text(f"[device.bob]\ncompensate_s = {self.every_s}\n" if self.every_s else "")
        options = {
            "policy": str(policy),
            "device": ["bob.compensator.retarders=3"] if self.every_s else [],
            "fiber": [
                f"length_km={KM}",
                f"polarization_drift_rad_per_sqrt_km={self.rms_rad}",
                f"polarization_drift_time_s={self.drift_s}",
            ],
        }
        (folder / "hours.py").write_text(HOURS)
        words = str(self.sessions), str(self.period_s), json.dumps(options)
        done = run_qmn("script", str(folder / "hours.py"), *words)
        assert not done.returncode, done.stdout + done.stderr
        rates: list[float] = json.loads(done.stdout.splitlines()[-1])
        return rates

    def simulated(self) -> NDArray[np.float64]:
        """Simulate process and loop apart; return the mean error rates of some experiments."""
        random = np.random.default_rng(3)
        sessions_s = np.maximum(np.arange(self.sessions) - 0.5, 0) * self.period_s
        pieces = max(int(np.ceil(self.rms_rad**2)), 1)
        fibers = self._draws(random, pieces)
        rates, now_s = [], np.full(EXPERIMENTS, -1e9)
        phases_s = random.random(EXPERIMENTS) * (self.every_s or 1)
        for session_s in sessions_s:
            looked = Rotation.identity(EXPERIMENTS)
            if self.every_s:
                look_s = session_s - (session_s + phases_s) % self.every_s
                assert (look_s > now_s).all()  # between any two sessions
                fibers, now_s = self._on(fibers, now_s, look_s, random)
                looked = _turn(fibers)
            fibers, now_s = self._on(fibers, now_s, np.full(EXPERIMENTS, session_s), random)
            left = (looked.inv() * _turn(fibers)).as_matrix()
            rates.append((1 - np.trace(left, axis1=1, axis2=2) / 3) / 2)
        return np.asarray(np.mean(rates, axis=0))

    def _draws(self, random: np.random.Generator, pieces: int) -> NDArray[np.float64]:
        sigma = self.rms_rad / np.sqrt(3 * pieces)
        return np.asarray(random.standard_normal((EXPERIMENTS, 2 * pieces, 3)) * sigma)

    def _on(
        self,
        fibers: NDArray[np.float64],
        now_s: NDArray[np.float64],
        then_s: NDArray[np.float64],
        random: np.random.Generator,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        kept = np.exp(-(then_s - now_s) / self.drift_s)[:, None, None]
        more = self._draws(random, fibers.shape[1] // 2)
        return kept * fibers + np.sqrt(1 - kept**2) * more, then_s


def _turn(fibers: NDArray[np.float64]) -> Rotation:
    whole = Rotation.identity(EXPERIMENTS)
    for piece in np.moveaxis(fibers, 1, 0):
        whole = Rotation.from_rotvec(piece) * whole
    return whole


@pytest.mark.parametrize(
    "days",
    [
        pytest.param(Days(5, 605, 2.0, 600, 11), id="an hour"),
        *(
            pytest.param(Days(36, 2400, 0.6, 1800, every_s), id=name, marks=pytest.mark.nightly)
            for name, every_s in {"a day": 210, "a day without": None}.items()
        ),
    ],
)
def test_a_compensator_keeps_the_error_rate_where_its_looks_do(days: Days, tmp_path: Path) -> None:
    rates, expected = days.measured(tmp_path), days.simulated()
    mean = expected.mean()
    spread = np.hypot(expected.std(), np.sqrt(mean * (1 - mean) / TESTED / days.sessions))
    assert abs(np.mean(rates) - mean) < 5 * spread, (np.mean(rates), mean, spread)
