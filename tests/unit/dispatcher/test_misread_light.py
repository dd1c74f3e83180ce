"""Detectors of light that tell the other bit now and then; closed forms, 5 sigma, seed 1."""

import numpy as np
import uvloop
from five_sigma import within

from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, Gates

COUNT = 20_000


def way(port: str, far_port: str) -> Fiber:
    """Return a fibre between two hosts' ports, without any length."""
    ends = [FiberEnd(end.partition("-")[0], end) for end in (port, far_port)]
    return Fiber(*ends, length_km=0.0)


def laboratory_of(ways: list[Fiber], devices: dict[str, Device]) -> Laboratory:
    tokens = dict.fromkeys(("alice", "eve", "bob"), "")
    return Laboratory(DispatcherConfig("", "", 1, tokens, ways, [], devices=devices))


def test_detectors_of_light_tell_wrongly_what_they_see_and_nothing_else() -> None:
    """A tenth of what half of the photons tell; that of gates is of qubits that are kept."""
    error, seen = 0.1, 0.5
    light = way("alice-q0", "bob-q0")
    detectors = Detectors(efficiency=seen, readout_error=error)
    devices = {"bob": Device(detectors=detectors, gates=Gates(readout_error=0.5))}
    laboratory = laboratory_of([light], devices)

    async def act() -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.prepare(np.ones(COUNT, np.uint8))
        await alice.send({(0, 0): "alice-q0"})
        await bob.receive((0, 0), "bob-q0")
        outcomes = await bob.measure((0, 0))
        assert within(int((outcomes != NO_CLICK).sum()), COUNT, seen)
        assert within(int((outcomes == 0).sum()), int((outcomes != NO_CLICK).sum()), error)

    uvloop.run(act())


def test_who_resends_light_resends_what_was_told() -> None:
    error = 0.1
    ways = [way("alice-q0", "eve-q0"), way("eve-q1", "bob-q0")]
    devices = {"eve": Device(detectors=Detectors(readout_error=error))}
    laboratory = laboratory_of(ways, devices)

    async def act() -> None:
        alice, eve, bob = (laboratory.host(name) for name in ("alice", "eve", "bob"))
        await alice.prepare(np.ones(COUNT, np.uint8))
        await alice.send({(0, 0): "alice-q0"})
        await eve.receive((0, 0), "eve-q0")
        report = await eve.resend((0, 0), np.zeros(COUNT, np.uint8))
        await eve.send({(0, 0): "eve-q1"})
        await bob.receive((0, 0), "bob-q0")
        found = await bob.measure((0, 0))
        assert within(int((report == 0).sum()), COUNT, error)
        assert np.array_equal(found, report)

    uvloop.run(act())
