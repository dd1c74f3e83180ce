"""Presets of optical switches: each can be, cites its source, and is what was published."""

import asyncio
import re
from pathlib import Path

import numpy as np
import pytest

from evidence.laboratory import Laboratory
from topologies.catalogue.switch_presets import SWITCH_PRESETS, optics_of
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.parameters.physics import BadParameter

PAGE = Path(__file__).parents[3] / "docs" / "networks.md"
COUNT = 100_000


@pytest.mark.parametrize("name", SWITCH_PRESETS)
def test_every_preset_can_be_and_cites_its_source(name: str) -> None:
    optics = optics_of("q1", {"preset": name})
    assert optics.name == "q1"
    cited = r"arXiv:\d{4}\.\d{4,5}|\d{4}\)"
    assert re.search(cited, SWITCH_PRESETS[name].source) or name == "ideal"


def test_the_page_has_what_the_presets_are() -> None:
    rows = [line for line in PAGE.read_text().splitlines() if line.startswith("| `")]
    units = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    for name in SWITCH_PRESETS:
        optics = optics_of("q1", {"preset": name})
        (row,) = [line for line in rows if f"`{name}`" in line.split("|")[1]]
        loss, time, crosstalk, depolarizing = (cell.split() for cell in row.split("|")[2:6])
        assert float(loss[0]) == optics.insertion_loss_db
        assert float(time[0]) * units[time[1]] == pytest.approx(optics.switching_time_s)
        assert crosstalk[0] == "none" or float(crosstalk[0]) == optics.crosstalk_db
        assert float(depolarizing[0]) == pytest.approx(optics.depolarizing, abs=5e-4)


def test_published_figures_in_their_own_units() -> None:
    """1.3 % loss is .057 dB; 120:1 is 20.8 dB; 1 MHz is a microsecond."""
    router = optics_of("q1", {"preset": "electro-optic"})
    assert 1 - 10 ** (-router.insertion_loss_db / 10) == pytest.approx(0.013, abs=5e-5)
    assert 1 - 0.75 * router.depolarizing == pytest.approx(0.99)  # its process fidelity
    loop = optics_of("q1", {"preset": "all-optical"})
    assert loop.crosstalk_db is not None
    assert 10 ** (loop.crosstalk_db / 10) == pytest.approx(120, rel=0.01)
    assert optics_of("q1", {"preset": "lithium-niobate"}).switching_time_s == 1 / 1e6


def test_what_is_given_goes_before_the_preset() -> None:
    optics = optics_of("q1", {"preset": "mems", "insertion_loss_db": 0.5})
    assert (optics.insertion_loss_db, optics.switching_time_s) == (0.5, 0.01)


def test_an_unknown_preset_names_those_there_are() -> None:
    with pytest.raises(BadParameter, match="q1: preset 'mirror': choose one of ideal, mems"):
        optics_of("q1", {"preset": "mirror"})


@pytest.mark.parametrize("switches", [1, 2])
def test_a_depolarising_switch_spoils_light_as_the_closed_form_says(switches: int) -> None:
    """X, Y, Z with p/4: a bit is wrong with p/2; of two, with (1 - (1 - p)^2) / 2."""
    p = 0.04

    async def act() -> int:
        names = [f"q{number}" for number in range(1, switches + 1)]
        optics = [optics_of(name, {"depolarizing": p}) for name in names]
        nodes = [FiberEnd("alice", "alice-q0")]
        for name in names:
            nodes += [FiberEnd(name, "1"), FiberEnd(name, "2")]
        nodes.append(FiberEnd("bob", "bob-q0"))
        fibers = [Fiber(*nodes[at : at + 2]) for at in range(0, len(nodes), 2)]
        tokens = {name: name for name in ("alice", "bob", *names)}
        laboratory = Laboratory(DispatcherConfig("", "", 1, tokens, fibers, optics))
        for name in names:
            await laboratory.connect(name, {1: 2})
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.prepare(np.zeros(COUNT, np.uint8))
        await alice.send({(0, 0): "alice-q0"})
        await bob.receive((0, 0), "bob-q0")
        return int(np.count_nonzero(await bob.measure((0, 0))))

    wrong, expected = asyncio.run(act()), (1 - (1 - p) ** switches) / 2
    assert abs(wrong - COUNT * expected) < 5 * (COUNT * expected * (1 - expected)) ** 0.5
