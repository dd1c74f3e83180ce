"""Changes of a fibre while light flows: its calibration, its traffic, who listens in.

Somebody on a fibre who measures some of its photons in Z or X and sends others in their place.

As nobody here wants to know what is found, that is a Pauli channel, exactly: a measurement in Z
leaves a state or flips its phase, each with 1/2; one in X leaves or flips the bit.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dispatcher.fiber.classical_light import ClassicalLight
from dispatcher.fiber.fluctuations import ThermalDrift
from dispatcher.fiber.noise import Effect, Passage, Z
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.network import Line
from dispatcher.refusal import invalid, precondition
from dispatcher.switch.timeline import Steps
from wire.dispatcher_pb2 import AdjustFiberRequest, CompensateRequest, Feedback
from wire.parameters.checks import check_number
from wire.parameters.physics import INTERVALS, BadParameter

X = 1


class Tap:
    """Intercept and resend, of a fraction of the photons that can be changed."""

    NAME = "tap"  # among the models of a fibre

    def __init__(self) -> None:
        self.fraction = Steps(0.0)

    def effect(self, passage: Passage) -> Effect:
        """Draw which photons are turned: X or Z."""
        schedule = passage.schedule
        if self.fraction.highest(schedule.first_ns, schedule.last_ns) == 0:
            return Effect()
        likely = self.fraction.at(schedule.times_ns) / 2

        def of_extra_pairs(beside: Passage, pulses: NDArray[np.int64]) -> NDArray[np.uint8]:
            return _turned(beside, likely[pulses] if isinstance(likely, np.ndarray) else likely)

        return Effect(paulis=_turned(passage, likely), of_extra_pairs=of_extra_pairs)


def _turned(passage: Passage, likely: float | NDArray[np.float64]) -> NDArray[np.uint8]:
    """Let X or Z happen to photons with this probability; return which, shape (k,)."""
    turned = passage.happens("turned", likely)
    paulis = np.zeros(passage.photons, dtype=np.uint8)
    count = int(np.count_nonzero(turned))
    paulis[turned] = np.where(passage.coins("basis", count), np.uint8(X), np.uint8(Z))
    return paulis


def adjust(layer: PhysicalLayer, _node: str, request: AdjustFiberRequest) -> int:
    """Do what is asked to all fibres between two nodes; return how many there are."""
    lines = layer.network.between(request.a, request.b)
    kind = request.WhichOneof("adjustment")
    if kind == "classical_mw":
        _illuminate(layer, lines, request.classical_mw)
    elif kind == "tapped":
        _tap(layer, lines, request.tapped)
    elif request.calibrate:
        _calibrate(layer, lines)
    else:
        raise invalid("no adjustment; name calibrate, classical_mw or tapped")
    return len(lines) // 2


def _calibrate(layer: PhysicalLayer, lines: Iterable[Line]) -> None:
    """Compensate each path's delay and turn of this moment, so that both drift from here."""
    now_ns = layer.clock.now_ns()
    lines = list(lines)
    for host in {line.far.node for line in lines}:
        if layer.compensation.of(host) is not None:
            layer.compensation.look_now(host, now_ns)
    for line in lines:
        layer.record(line.near.node, "calibrate", port=line.near.port, time_ns=now_ns)
        for name, model in line.noise.items():
            if isinstance(model, ThermalDrift):
                history = layer.history.of_model(line.near.node, line.near.port, name)
                history.remember(np.array([now_ns]), np.zeros(1))


def compensate(layer: PhysicalLayer, node: str, request: CompensateRequest) -> Feedback:
    """Have the compensator of a host look now, and from then on at an interval."""
    if layer.compensation.of(node) is None:
        raise precondition(f"{node} has no compensator: give it compensator.retarders, 3 or 4")
    every_s = request.every_s if request.HasField("every_s") else None
    if every_s is not None:
        check_number("every_s", every_s, *INTERVALS, invalid)
    now_ns = layer.clock.now_ns()
    interval_s = layer.compensation.look(node, now_ns, every_s)
    layer.record(node, "tune", detail=f"compensator: looks every {interval_s:g} s")
    return Feedback(time_ns=now_ns, exact=True)


def _illuminate(layer: PhysicalLayer, lines: Iterable[Line], power_mw: float) -> None:
    now_ns = layer.clock.now_ns()
    for line in lines:
        where = f"fiber at {line.near.port} of {line.near.node}"
        try:
            replace(line.fiber, classical_mw=power_mw).check(where)
        except BadParameter as error:
            raise invalid(str(error)) from error
    for line in lines:
        detail = f"classical light {power_mw:g} mW"
        layer.record(line.near.node, "tune", None, line.near.port, detail, now_ns)
        for model in line.noise.values():
            if isinstance(model, ClassicalLight):
                model.power_mw.set(power_mw, now_ns)


def _tap(layer: PhysicalLayer, lines: Iterable[Line], fraction: float) -> None:
    if not 0 <= fraction <= 1:
        raise invalid(f"tapped {fraction}: choose 0 to 1, a fraction of the photons")
    now_ns = layer.clock.now_ns()
    for line in lines:
        detail = f"tapped {fraction:g}"
        layer.record(line.near.node, "tune", None, line.near.port, detail, now_ns)
        model = line.noise.setdefault(Tap.NAME, Tap())
        assert isinstance(model, Tap)
        model.fraction.set(fraction, now_ns)
