"""The quantum hardware of the hosts: what it is like, and the detectors that remember clicks."""

from collections.abc import Mapping

from dispatcher.devices.detectors import DetectorPair
from wire.parameters.physics import Device

IDEAL = Device()


class Devices:
    """The devices of all hosts; a host that is not listed has ideal ones."""

    def __init__(self, listed: Mapping[str, Device]) -> None:
        """Have these; raise BadParameter for what no device is like."""
        for host, device in listed.items():
            device.check(host)
        self._listed = dict(listed)
        self._detectors: dict[tuple[str, str], DetectorPair] = {}

    def of(self, node: str) -> Device:
        """Return what a host's device is like."""
        return self._listed.get(node, IDEAL)

    def detectors(self, node: str, arm: str) -> DetectorPair:
        """Return the two detectors in one arm of a host's set-up, always the same two."""
        if (node, arm) not in self._detectors:
            self._detectors[node, arm] = DetectorPair(self.of(node).detectors)
        return self._detectors[node, arm]
