"""A QNIC as a session has it: of its fibres' channels those that carry the session's light."""

from collections.abc import Mapping
from typing import Any, cast

from hosts.hardware.qnic import Qnic
from wire.optical import ANY_WAVELENGTH, frequency_mhz


class _Carrying:
    """Another QNIC with some of its ports."""

    def __init__(self, qnic: Qnic, ports: list[str]) -> None:
        self._qnic, self.ports = qnic, ports

    def __getattr__(self, name: str) -> Any:
        return getattr(self._qnic, name)


def carrying(qnic: Qnic, channels_mhz: Mapping[str, int], wavelength_pm: int) -> Qnic:
    """Return a QNIC whose ports are those that carry a wavelength, in order.

    `channels_mhz` has the frequency of each port that is a channel. Of any wavelength it is the
    channel of the first port. Raise ValueError for a wavelength outside the optical range.
    """
    first = channels_mhz.get(qnic.ports[0]) if qnic.ports else None
    wanted = first if wavelength_pm == ANY_WAVELENGTH else frequency_mhz(wavelength_pm)
    ports = [port for port in qnic.ports if channels_mhz.get(port, wanted) == wanted]
    return cast(Qnic, _Carrying(qnic, ports))
