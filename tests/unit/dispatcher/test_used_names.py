"""Names of blocks that are used again: other photons, other random numbers."""

from itertools import combinations

import numpy as np
import pytest
import uvloop
from five_sigma import within

from dispatcher.layer import ownership
from dispatcher.layer.ownership import UsedNames, UsedNumbers
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig
from wire.dispatcher_pb2 import MeasureRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, PairSource

COUNT = 10_000


def test_the_outcomes_of_a_name_that_is_used_again_are_new() -> None:
    """Fair bits agree in half of the places; so do which are detected, and how many pairs were."""
    source = PairSource(statistics="poisson", mean_pairs=1.0)
    device = Device(source=source, detectors=Detectors(efficiency=0.5))

    async def seen(device: Device) -> list[np.ndarray]:
        config = DispatcherConfig("", "", 1, {"alice": ""}, [], [], devices={"alice": device})
        alice, found = Laboratory(config).host("alice"), []
        for _ in range(3):
            await alice.create(COUNT)
            found.append(await alice.measure((0, 0), MeasureRequest.X))
            await alice.discard((0, 1))
        return found

    for one, other in combinations(uvloop.run(seen(Device())), 2):
        assert within(int(np.count_nonzero(one == other)), COUNT, 0.5)
    for one, other in combinations(uvloop.run(seen(device)), 2):
        dark = np.exp(-0.5)  # a pulse that no detector sees: thinned Poisson of mean .5
        both = np.count_nonzero((one == NO_CLICK) & (other == NO_CLICK))
        assert within(int(both), COUNT, dark**2)


def test_each_use_of_a_number_is_told_from_the_others() -> None:
    names, draws = UsedNames(), np.random.default_rng(1)
    reports = set()
    for number in (*range(50), *draws.integers(0, 60, 500).tolist(), 1 << 31, (1 << 31) + 1):
        for session in (7, 8):
            reports.add((session, number, names.use(session, number)))
    assert len(reports) == 2 * 552
    assert (7, 3, "") in reports
    assert (7, 1 << 31, "") in reports


def test_what_is_remembered_is_bounded_and_no_use_is_taken_for_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ownership, "MOST_RANGES", 4)
    monkeypatch.setattr(ownership, "MOST_REPEATED", 3)
    numbers, report = UsedNumbers(), set()
    uses = [*range(0, 40, 2), *range(40), *range(0, 40, 3), 100, 0, 1, 2]
    for number in uses:
        report.add((number, numbers.use(number)))
    assert len(report) == len(uses)
