"""The ranges of devices: everything else is refused with host, name, value and range."""

import json
import re
from dataclasses import asdict
from typing import Any

import pytest

from wire.features import (
    ABSORB,
    EMIT,
    EVERYTHING,
    GATE,
    HERALD,
    INTERFERE,
    MEASURE,
    STORE,
    Feature,
    NodeFeatures,
)
from wire.malformed import MalformedPacket
from wire.parameters.physics import (
    BadParameter,
    BellAnalyser,
    Detectors,
    Device,
    Emitter,
    Gates,
    Memory,
    PairSource,
)
from wire.typed_json import read

REFUSED = [
    (Device(PairSource(fidelity=0.2)), "alice, source: fidelity 0.2: choose 0.25 to 1"),
    (Device(PairSource(mean_pairs=float("nan"))), "source: mean_pairs nan: choose 0 to 10"),
    (Device(PairSource(statistics="laser")), "statistics 'laser': choose one of single"),
    (Device(PairSource(bell_diagonal=(0.5, 0.5))), "bell_diagonal (0.5, 0.5) is not 4"),
    (Device(PairSource(bell_diagonal=(0.5, 0.5, 0.5, -0.5))), "is not 4 probabilities"),
    (Device(PairSource(bell_diagonal=(0.7, 0.1, 0.1, 0.2))), "that add up to 1"),
    (
        Device(PairSource(fidelity=0.9, bell_diagonal=(0.7, 0.1, 0.1, 0.1))),
        "are both given; name one",
    ),
    (Device(memory=Memory(t1_s=0.0)), "alice, memory: t1_s 0.0: choose 1e-12 or more"),
    (Device(memory=Memory(t1_s=1.0, t2_s=2.1)), "memory: t2_s 2.1: choose 1e-12 to 2 (twice t1_s)"),
    (Device(memory=Memory(t1_s=1.0)), "memory: t2_s inf: choose"),
    (Device(memory=Memory(capacity=1.5)), "capacity 1.5: choose 0 to 4000000 (a whole number)"),  # type: ignore[arg-type]
    (Device(detectors=Detectors(efficiency=80)), "detectors: efficiency 80: choose 0 to 1"),
    (Device(detectors=Detectors(dark_count_hz=-1.0)), "dark_count_hz -1.0: choose 0 to 1e+09"),
    (
        Device(analyser=BellAnalyser(kind="half")),
        "kind 'half': choose one of complete, linear",
    ),
    (Device(analyser=BellAnalyser(visibility=True)), "visibility True: choose 0 to 1"),
    (Device(gates=Gates("some")), "alice, gates: kind 'some': choose one of any, paulis"),
    (Device(gates=Gates("any", 2.0)), "gates: one_qubit_depolarizing 2.0: choose 0 to 1"),
    (
        Device(analyser=BellAnalyser("gates"), gates=Gates("paulis")),
        "alice, analyser: kind 'gates' with gates of kind 'paulis'",
    ),
    (Device(memory=Detectors()), "alice: memory Detectors("),  # type: ignore[arg-type]
]


@pytest.mark.parametrize(("device", "message"), REFUSED)
def test_what_no_device_is_like_is_refused(device: Device, message: str) -> None:
    with pytest.raises(BadParameter, match=re.escape(message)):
        device.check("alice")


@pytest.mark.parametrize(
    "device",
    [
        Device(),
        Device(PairSource("thermal", 0.05, bell_diagonal=(0.97, 0.01, 0.01, 0.01))),
        Device(memory=Memory(t1_s=1e-3, t2_s=2e-3), detectors=Detectors(efficiency=0.8)),
        Device(analyser=BellAnalyser("linear", 0.98, 1e11)),
        Device(analyser=BellAnalyser("gates"), gates=Gates("any", 1e-5, 5e-3)),
    ],
)
def test_a_device_reads_back_from_json_the_same(device: Device) -> None:
    device.check("alice")
    assert read(Device, json.loads(json.dumps(asdict(device)))) == device


@pytest.mark.parametrize(
    "given", [{"laser": {}}, {"memory": {"t3_s": 1.0}}, {"source": {"brightness": 2}}]
)
def test_a_part_that_no_device_has_is_refused(given: dict[str, Any]) -> None:
    with pytest.raises(MalformedPacket, match=r"laser|t3_s|brightness"):
        read(Device, given)


def test_a_fidelity_means_the_other_bell_states_alike() -> None:
    assert PairSource(fidelity=0.7).bell_probabilities() == pytest.approx((0.7, 0.1, 0.1, 0.1))


@pytest.mark.parametrize(
    ("device", "wanting"),
    [
        (Device(), HERALD),
        (Device(emitter=Emitter("two-click")), Feature(0)),
        (Device(PairSource("none")), EMIT | HERALD),
        (Device(memory=Memory(capacity=0), emitter=Emitter("two-click")), STORE | ABSORB | HERALD),
        (Device(gates=Gates("paulis")), GATE | HERALD),
        (Device(memory=Memory(kind="emissive")), ABSORB | HERALD),
        (
            Device(detectors=Detectors(efficiency=0.0, dark_count_hz=100.0)),
            MEASURE | INTERFERE | HERALD,
        ),
        (Device(analyser=BellAnalyser("gates")), INTERFERE | HERALD),
        (
            Device(PairSource("none"), Memory(capacity=0), gates=Gates("paulis")),
            ~(MEASURE | INTERFERE),
        ),
    ],
)
def test_what_a_device_can_do_follows_from_its_parts(device: Device, wanting: Feature) -> None:
    assert device.features == EVERYTHING & ~wanting


def test_a_host_announces_what_its_device_can_do_and_how_much_it_stores() -> None:
    device = Device(memory=Memory(capacity=32), gates=Gates("paulis"))
    assert device.node_features == NodeFeatures(EMIT | STORE | ABSORB | MEASURE | INTERFERE, 32)
