"""Hours of a network with drift, which stepped time makes short."""

import json
from pathlib import Path

import pytest
from loaded import run_qmn

MINUTES, SLOPE_K_PER_S, KM, GATE_PS = 60, 1e-3, 10.0, 1000.0
PS_PER_K_AND_KM = 8.2e-6 * 1e12 / 2.04e5  # of each kelvin, 8.2e-6 of the time light takes
HOUR = """
import json, sys
from hosts.client import blocking_session
from hosts.stack_socket import QuantumSocketError
from qmn.changes.fibers import adjust
from qmn.running.network import dispatcher_of_running_network
from qmn.scripting import start
from wire.dispatcher_pb2 import AdjustFiberRequest

minutes, calibrated_each, km, slope = *map(int, sys.argv[1:3]), *map(float, sys.argv[3:])
warming = f"temperature_slope_k_per_s={slope}"
with start("sdc", time="stepped", length_km=km, fiber=(warming,)) as network:
    time = network.runtime.time
    began_s, kept = time.now_s(), []
    for minute in range(minutes):
        if minute % calibrated_each == 0:
            for host in ("alice", "bob"):
                request = AdjustFiberRequest(a=host, b="q1", calibrate=True)
                adjust(dispatcher_of_running_network(), request)
        keys = network.runtime.socket, "bb84", ("alice", "bob"), 7, time
        try:
            with blocking_session(*keys, limit_s=60, count=2000) as asked:
                asked.results()
                asked.end()
            kept.append(asked.summary["sifted_bits"] >= 2000)
        except QuantumSocketError:
            kept.append(False)
        network.sleep(began_s + 60 * (minute + 1) - time.now_s())
print(json.dumps(kept))
"""


@pytest.mark.nightly
@pytest.mark.parametrize("calibrated_each", [10, 20])
def test_an_hour_of_a_fibre_that_warms_has_keys_while_it_is_calibrated(
    calibrated_each: int, tmp_path: Path
) -> None:
    """Light over two fibres that warm evenly is late by more than half a gate from a minute on."""
    (tmp_path / "hour.py").write_text(HOUR)
    words = (str(MINUTES), str(calibrated_each), str(KM), str(SLOPE_K_PER_S))
    done = run_qmn("script", str(tmp_path / "hour.py"), *words)
    assert not done.returncode, done.stdout + done.stderr
    late_s = GATE_PS / 2 / (2 * KM * PS_PER_K_AND_KM * SLOPE_K_PER_S)
    expected = [60 * (minute % calibrated_each) < late_s for minute in range(MINUTES)]
    assert json.loads(done.stdout.splitlines()[-1]) == expected
