"""Compensators of hosts and switches on one path; 5 sigma, seed 1."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import uvloop
from compensators_scene import COUNT, FIBER, HOSTS, IDEAL, RATE_HZ, errors, expected, require
from five_sigma import within
from numpy.typing import NDArray

from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.parameters.physics import BadParameter, Compensator, Device
from wire.parameters.switch import QuantumSwitch

STILL = {"polarization_drift_time_s": 1e9}


def laboratory(
    switch: QuantumSwitch, devices: dict[str, Device], *fibers: dict[str, Any]
) -> Laboratory:
    """Return alice and bob, each joined to a switch by such a fibre."""
    ends = [
        (FiberEnd(host, f"{host}-q0"), FiberEnd("q1", str(i))) for i, host in enumerate(HOSTS, 1)
    ]
    laid = [Fiber(*way, **FIBER | more) for way, more in zip(ends, fibers, strict=True)]
    tokens = dict.fromkeys((*HOSTS, "q1"), "")
    return Laboratory(DispatcherConfig("", "", 1, tokens, laid, [switch], devices=devices))


async def switched(there: Laboratory) -> NDArray[np.bool_]:
    await there.connect("q1", {1: 2})
    return await errors(there)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("others_s", [0.02, 0.05, None])
def test_compensators_of_a_switch_and_a_host_undo_a_section_each(others_s: float | None) -> None:
    """Of independent turns by any axis 1 - 2 e multiplies; None: the other fibre turns nothing."""
    one, other = (replace(IDEAL, every_s=every_s) for every_s in (0.05, others_s or 1e6))
    fibers = [{}, {} if others_s else {"polarization_drift_rad_per_sqrt_km": 0.0}]
    there = laboratory(
        QuantumSwitch("q1", compensator=one), {"bob": Device(compensator=other)}, *fibers
    )
    found = uvloop.run(switched(there))
    each = [expected(0.8, every_s) for every_s in (0.05, others_s) if every_s]
    rate = (1 - np.prod([1 - 2 * e for e, _ in each])) / 2
    require(found, (float(rate), float(np.hypot.reduce([sigma for _, sigma in each]))))


def test_light_of_the_switch_itself_does_not_meet_its_compensators() -> None:
    """They take half of what hosts send, and of the pairs that it makes nothing."""
    part = Compensator(3, insertion_loss_db=10 * np.log10(2))
    switch = QuantumSwitch("q1", sources=1, compensator=part)
    there = laboratory(switch, {}, STILL, STILL)
    assert within(uvloop.run(switched(there)).size, COUNT, 0.5)

    async def pairs() -> list[int]:
        await there.connect("q1", {62_001: 1, 62_002: 2})
        asked = {"switch": "q1", "port": 62_001, "session": 1, "number": 9, "count": 1000}
        await there.act("q1", "emit", there.request("emit", rate_hz=1000, **asked))
        found = []
        for half, name in enumerate(HOSTS):
            await there.host(name).receive((9, half), f"{name}-q0")
            found.append(int((await there.host(name).measure((9, half)) < 2).sum()))
        return found

    assert uvloop.run(pairs()) == [1000, 1000]


def test_light_that_is_sent_back_meets_a_compensator_on_each_way() -> None:
    """Each way sees other looks; of turns that stay nothing is left at either end."""

    async def found() -> int:
        there = ring()
        alice, bob = (there.host(name) for name in HOSTS)
        states = (np.arange(1000) % 6).astype(np.uint8)
        await alice.prepare(states)
        await alice.send({(0, 0): "alice-q0"}, RATE_HZ)
        await bob.receive((0, 0), "bob-q0")
        await bob.send({(0, 0): "bob-q1"}, RATE_HZ)
        await alice.receive((0, 0), "alice-q1")
        bits = await alice.measure((0, 0), bases=states >> np.uint8(1))
        return int(np.count_nonzero(bits != states & 1))

    assert uvloop.run(found()) == 0


def ring() -> Laboratory:
    """Return alice and bob, who both look twenty times a second, and two fibres between them."""
    devices = dict.fromkeys(HOSTS, Device(compensator=replace(IDEAL, every_s=0.05)))
    ways = [[FiberEnd(host, f"{host}-q{i}") for host in HOSTS] for i in (0, 1)]
    fibers = [Fiber(*way, **FIBER | STILL) for way in ways]
    tokens = dict.fromkeys(HOSTS, "")
    return Laboratory(DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices))


@pytest.mark.parametrize(
    ("part", "refusal"),
    [
        (Compensator(2), "q1, compensator: retarders 2: choose 0, 3 or 4"),
        (Compensator(3, reference="error-rate"), "q1 measures no errors: choose light"),
    ],
)
def test_compensators_of_a_switch_that_cannot_be_are_refused(
    part: Compensator, refusal: str
) -> None:
    with pytest.raises(BadParameter, match=refusal):
        QuantumSwitch("q1", compensator=part).check()


@pytest.mark.parametrize("rotation", [0, 1, 2, 3])
def test_behind_a_switch_the_turns_of_both_fibres_are_undone(rotation: int) -> None:
    """The switch's own rotation stays: by X and XZ every bit is flipped."""

    async def found() -> NDArray[np.uint8]:
        ends = [
            (FiberEnd(host, f"{host}-q0"), FiberEnd("q1", str(i)))
            for i, host in enumerate(HOSTS, 1)
        ]
        fibers = [Fiber(*way, **FIBER | {"polarization_drift_time_s": 1e9}) for way in ends]
        switches = [QuantumSwitch("q1", rotation=rotation)]
        devices = {"bob": Device(compensator=IDEAL)}
        tokens = dict.fromkeys((*HOSTS, "q1"), "")
        there = Laboratory(DispatcherConfig("", "", 1, tokens, fibers, switches, devices=devices))
        await there.connect("q1", {1: 2})
        await there.host("alice").prepare(np.zeros(1000, np.uint8))
        await there.host("alice").send({(0, 0): "alice-q0"})
        await there.host("bob").receive((0, 0), "bob-q0")
        return await there.host("bob").measure((0, 0))

    assert (uvloop.run(found()) == rotation % 2).all()
