"""Checks of a quantum switch's optics before a network is made with it."""

from collections.abc import Collection

from wire.config import BadConfig, QuantumSwitch

TEMPERATURE_C = (-100.0, 300.0)
LOSS_DB = (0.0, 100.0)
MIN_POWER_DBM = (-100.0, 0.0)
FREQUENCY_MHZ = (1, 2**32 - 1)
RANGES: dict[str, tuple[float, float]] = {
    "switching_time_s": (0.0, 60.0),
    "insertion_loss_db": LOSS_DB,
    "rotation": (0, 3),
    "crosstalk_db": LOSS_DB,
    "temperature_c": TEMPERATURE_C,
    "max_temperature_c": TEMPERATURE_C,
    "hot_loss_db": LOSS_DB,
    "min_frequency_mhz": FREQUENCY_MHZ,
    "max_frequency_mhz": FREQUENCY_MHZ,
    "grid_mhz": FREQUENCY_MHZ,
    "min_power_dbm": MIN_POWER_DBM,
}
WHOLE = ("rotation", "min_frequency_mhz", "max_frequency_mhz", "grid_mhz")


def check(switch: QuantumSwitch) -> None:
    """Raise BadConfig for optics that cannot be, whatever the switch's ports are."""
    for name in RANGES:
        value = getattr(switch, name)
        if value is not None or name != "crosstalk_db":
            _check_value(switch.name, name, value)
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
        _check_value(where, "insertion_loss_db", path.insertion_loss_db)
        _check_value(where, "rotation", path.rotation)


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


def _check_value(where: str, name: str, value: object) -> None:
    """Raise BadConfig for what is not a number of its range; NaN is in none."""
    least, most = RANGES[name]
    kinds = int if name in WHOLE else (int, float)
    if isinstance(value, bool) or not isinstance(value, kinds) or not least <= value <= most:
        meaning = " (I, X, Z, XZ)" if name == "rotation" else ""
        raise BadConfig(f"{where}: {name} {value!r} is not {least:g} to {most:g}{meaning}")
