"""Analysers and memories of a switch to its controllers: what they are, and how light ended."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

from qswitch_agent.openflow.ports import Port
from wire.analyser_frames import BROADCAST, AnalyserFrame, frames_of
from wire.parameters.physics import Device
from wire.parameters.switch import InnerPort
from wire.part_descriptions import describe

NO_ADDRESS = bytes(6)
IDEAL = Device()


class InnerPorts:
    def __init__(
        self,
        ports: Mapping[int, InnerPort],
        send: Callable[[int, bytes], None],
        parts: Device = IDEAL,
        announced: Callable[[Port], None] = lambda _port: None,
    ) -> None:
        """`send` lets flow entries decide on a frame that comes from a port.

        `announced` has controllers hear of a port that has changed.
        """
        self._ports, self._send, self._parts = ports, send, parts
        self._announced = announced
        self._known: dict[int, Port] = {}  # the inner ports

    def description(self, number: int, memory: Mapping[str, Any]) -> bytes:
        """Return the property of a port that says what it leads to; `memory` is what has changed"""
        parts = replace(self._parts, memory=replace(self._parts.memory, **memory))
        return describe(self._ports[number], parts)

    def update(self, ports: list[Port]) -> None:
        self._known |= {port.number: port for port in ports if port.number in self._ports}

    def announce(self, numbers: Iterable[int]) -> None:
        for number in sorted(numbers):
            if number in self._known:
                self._announced(self._known[number])

    def report(self, report: AnalyserFrame) -> None:
        """Send outcomes by the flow entries of the analyser's port."""
        entry = self._known.get(report.port)
        sender = entry.address if entry else NO_ADDRESS
        for frame in frames_of(report):
            self._send(report.port, frame.encode(BROADCAST, sender))
