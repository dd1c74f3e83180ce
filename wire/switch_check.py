"""Checks of a quantum switch's optics before a network is made with it."""

from collections.abc import Collection
from dataclasses import fields

from wire.config import BadConfig, PathOptics, QuantumSwitch


def check(switch: QuantumSwitch) -> None:
    """Raise BadConfig for optics that cannot be, whatever the switch's ports are."""
    _check_values(switch.name, switch)
    if switch.min_frequency_mhz > switch.max_frequency_mhz:
        raise BadConfig(
            f"{switch.name}: min_frequency_mhz {switch.min_frequency_mhz} is above "
            f"max_frequency_mhz {switch.max_frequency_mhz}; name the lower one first"
        )
    named = set()
    for path in switch.paths:
        ports = path.in_port, path.out_port
        where = f"{switch.name}, path {path.in_port} -> {path.out_port}"
        if ports in named:
            raise BadConfig(f"{where} is named twice; name each path once")
        named.add(ports)
        _check_values(where, path)


def check_ports(switch: QuantumSwitch, ports: Collection[int]) -> None:
    """Raise BadConfig for a path whose ports no fibre ends in."""
    for path in switch.paths:
        for port in (path.in_port, path.out_port):
            if port not in ports:
                known = ", ".join(map(str, sorted(ports))) or "none"
                raise BadConfig(
                    f"{switch.name}, path {path.in_port} -> {path.out_port}: "
                    f"no fibre ends in port {port!r}; fibres end in {known}"
                )


def _check_values(where: str, optics: QuantumSwitch | PathOptics) -> None:
    """Raise BadConfig for a field out of the range that is declared with it."""
    for each in fields(optics):
        value = getattr(optics, each.name)
        if "range" in each.metadata and not (value is None and each.default is None):
            _check_value(where, each.name, value, *each.metadata["range"])


def _check_value(where: str, name: str, value: object, least: float, most: float) -> None:
    """Raise BadConfig for what is no number of its range; NaN is in none."""
    kinds = int if isinstance(least, int) else (int, float)
    if isinstance(value, bool) or not isinstance(value, kinds) or not least <= value <= most:
        meaning = " (I, X, Z, XZ)" if name == "rotation" else ""
        raise BadConfig(f"{where}: {name} {value!r} is not {least:g} to {most:g}{meaning}")
