"""Time tags of clicks; the seed is 1."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import uvloop

from applications.time_tags import words
from evidence.laboratory import START_NS, Laboratory, block_id
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.malformed import MalformedPacket
from wire.parameters.physics import Detectors, Device, PairSource

pytest.importorskip("pyarrow")

from pyarrow import parquet

from applications.time_tags import recorder

Columns = dict[str, np.ndarray[Any, Any]]
KEY, RATE_HZ, PULSES = bytes(range(16)), 100_000_000, 200_000
CARD = Detectors(
    efficiency=0.8,
    dark_count_hz=1e6,
    gate_s=4e-9,
    dead_time_s=5e-8,
    jitter_ps=300,
    readout_error=0.02,
)
CLOCK: dict[str, Any] = {
    "clock_offset_s": 0.25,
    "clock_skew_ppm": 20.0,
    "clock_jitter_ps": 40.0,
}


def near(value: float, expected: float, sigma: float) -> bool:
    return abs(value - expected) <= 5 * sigma


def test_words_are_those_of_the_cards() -> None:
    """Section 0 of filespec.txt: 1 s is 8,000,000,000 units, 0xee6b2800_0000 in its place."""
    units, patterns = [8_000_000_000, (1 << 49) - 1, (1 << 49) + 3], [4, 1, 8]
    data = words.encode(np.array(units), np.array(patterns, np.uint8))
    assert data.hex(" ", 4) == "6bee0000 04000028 ffffffff 0180ffff 00000000 08800100"
    times, detectors = words.decode(data)
    assert times.tolist() == units
    assert detectors.tolist() == patterns


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (bytes(7), "7 bytes are not tags"),
        (bytes(8), "tag 0 is of no detector"),
        (bytes(4) + b"\x11\0\0\0", "bits between time and detectors"),
        (words.encode(np.array([2, 1]), np.array([1, 1], np.uint8)), "do not ascend"),
    ],
)
def test_bytes_that_a_card_never_writes_are_refused(data: bytes, text: str) -> None:
    with pytest.raises(MalformedPacket, match=text):
        words.decode(data)


def network(detectors: Detectors, source: PairSource) -> DispatcherConfig:
    """Return 204 m of fibre, 1 us, from alice to bob."""
    fiber = Fiber(FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0"), length_km=0.204)
    devices = {"alice": Device(source), "bob": Device(detectors=detectors)}
    return DispatcherConfig("", "", 1, dict.fromkeys(devices, ""), [fiber], [], devices=devices)


async def measured(laboratory: Laboratory, number: int = 0) -> int:
    """Send one block of pulses from alice to bob; return how often his detectors click."""
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    await alice.emit(PULSES, number, KEY)
    await alice.send({(number, 0): "alice-q0"}, RATE_HZ)
    await bob.receive((number, 0), "bob-q0")
    request = laboratory.request("measure", block=block_id((number, 0)), key=KEY)
    return int((await laboratory.act("bob", "measure", request)).clicks)


def tagged(folder: Path, detectors: Detectors, source: PairSource) -> tuple[int, Columns, Columns]:
    """Return bob's clicks, as he counts them, his tags, and the truth of them."""
    config = network(detectors, source)
    laboratory = Laboratory(config)
    with recorder.begin(replace(config, tags=str(folder)), START_NS) as observer:
        laboratory.layer.observer = observer
        clicks = uvloop.run(measured(laboratory))
    tags, truth = (
        {name: column.to_numpy() for name, column in zip(table.column_names, table, strict=True)}
        for table in (parquet.read_table(folder / f"bob{kind}.parquet") for kind in ("", ".truth"))
    )
    return clicks, tags, truth


LASERS = {
    "sparse": PairSource("poisson", mean_pairs=0.2, jitter_ps=400),
    "dense": PairSource("single", jitter_ps=400),
}


@pytest.mark.parametrize("light", LASERS)
def test_tags_are_the_clicks_that_a_host_counts(light: str, tmp_path: Path) -> None:
    clicks, tags, truth = tagged(tmp_path / "tags", CARD, LASERS[light])
    assert tags["time_ps"].size == truth["time_ps"].size == clicks > 10_000
    assert (np.diff(tags["time_ps"]) >= 0).all()
    assert not truth["light"].all()
    off_ps = truth["time_ps"] - truth["slot"] * 1e12 / RATE_HZ
    assert (np.abs(off_ps - off_ps.mean()) < 2_100).all()  # half a gate
    light_ps = off_ps[truth["light"]]
    # Jitter of source and detector: 500 ps rms together, cut at four of these.
    spread = 500 * math.sqrt(1 - 8 * math.exp(-8) / math.sqrt(2 * math.pi))
    assert near(float(light_ps.std()), spread, spread / math.sqrt(2 * light_ps.size))
    dark_ps = off_ps[~truth["light"]]
    flat = 4_000 / math.sqrt(12)
    assert near(float(dark_ps.std()), flat, flat / math.sqrt(5 * dark_ps.size))
    units, patterns = words.decode((tmp_path / "tags" / "bob.tags").read_bytes())
    assert int(np.unpackbits(patterns).sum()) == clicks
    assert {1, 2, 4, 8} <= set(patterns.tolist()) <= {1, 2, 4, 8, 5, 10}  # two of one basis
    assert np.isin(units, tags["time_ps"] // words.UNIT_PS).all()


def test_a_clock_is_ahead_faster_and_errs(tmp_path: Path) -> None:
    _clicks, plain, _truth = tagged(tmp_path / "plain", CARD, LASERS["sparse"])
    _clicks, tags, truth = tagged(tmp_path / "clock", replace(CARD, **CLOCK), LASERS["sparse"])
    assert np.array_equal(np.sort(truth["time_ps"]), np.sort(plain["time_ps"]))
    ahead_ps = tags["time_ps"] - truth["time_ps"] * (1 + 20e-6) - 0.25e12
    assert near(float(ahead_ps.mean()), 0.0, 40 / math.sqrt(ahead_ps.size))
    assert near(float(ahead_ps.std()), 40.0, 40 / math.sqrt(2 * ahead_ps.size))


def test_tags_ascend_however_the_clock_errs(tmp_path: Path) -> None:
    """Blocks are 2 ms long and have 20 tags; each errs by 1 ms, the most that there is."""
    detectors = Detectors(**CLOCK | {"clock_jitter_ps": 1e9})
    config = network(detectors, PairSource("poisson", mean_pairs=1e-4))
    laboratory, folder = Laboratory(config), tmp_path / "tags"

    async def blocks() -> int:
        return sum([await measured(laboratory, number) for number in range(40)])

    with recorder.begin(replace(config, tags=str(folder)), START_NS) as observer:
        laboratory.layer.observer = observer
        clicks = uvloop.run(blocks())
        assert 0 < (folder / "bob.tags").stat().st_size < 8 * clicks  # they do not wait for the end
    units, _patterns = words.decode((folder / "bob.tags").read_bytes())
    times_ps = parquet.read_table(folder / "bob.parquet")["time_ps"].to_numpy()
    assert times_ps.size == clicks
    assert (np.diff(times_ps) >= 0).all()
    assert np.array_equal(np.unique(units), np.unique(times_ps // words.UNIT_PS))


def test_a_run_that_fails_keeps_its_last_tags(tmp_path: Path) -> None:
    config, folder = network(CARD, LASERS["sparse"]), tmp_path / "tags"
    laboratory, clicks = Laboratory(config), []

    def fail() -> None:
        with recorder.begin(replace(config, tags=str(folder)), START_NS) as observer:
            laboratory.layer.observer = observer
            clicks.append(uvloop.run(measured(laboratory)))
            raise InterruptedError

    with pytest.raises(InterruptedError):
        fail()
    assert [parquet.read_table(folder / "bob.parquet").num_rows] == clicks


def test_readout_errors_are_in_the_tags_and_known_to_the_truth(tmp_path: Path) -> None:
    clicks, _tags, truth = tagged(tmp_path / "tags", CARD, LASERS["sparse"])
    assert near(int(truth["misread"].sum()), 0.02 * clicks, math.sqrt(0.02 * 0.98 * clicks))
