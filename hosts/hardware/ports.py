"""The fibre ports of a host as its kernel sees them."""

from collections.abc import Iterable
from pathlib import Path

from wire.device import DevicePort

INTERFACES = Path("/sys/class/net")


def read_ports(names: Iterable[str]) -> tuple[DevicePort, ...]:
    """Return which fibre ports have light: a cut fibre has none, nor has one that is gone."""
    return tuple(DevicePort(name, _is_up(name)) for name in names)


def _is_up(name: str) -> bool:
    try:
        return (INTERFACES / name / "operstate").read_text().strip() == "up"
    except OSError:
        return False
