"""The choice of a driver, by the agent's configuration."""

from urllib.parse import urlsplit

from qswitch_agent.hardware.optics import OpticalHardware
from qswitch_agent.hardware.scpi import MatrixPort, ScpiSwitch
from qswitch_agent.hardware.simulated import SimulatedSwitch
from wire.config import AgentConfig, BadConfig

SCPI_PORT = 5025  # registered with IANA as scpi-raw


def hardware(config: AgentConfig) -> OpticalHardware:
    """Return the driver; raise BadConfig if the configuration names none that can be."""
    if not config.hardware:
        if config.hardware_ports:
            raise BadConfig("hardware_ports are given without hardware; name the instrument, too")
        return SimulatedSwitch(config.switch, config.dispatcher, config.token, config.time)
    if config.time_scale != 1 or config.time_folder:
        clock = "stepped time" if config.time_folder else f"time scale {config.time_scale:g}"
        raise BadConfig(
            f"{clock} with hardware {config.hardware}: an instrument runs in real time; "
            "leave it out"
        )
    host, port = _address(config.hardware)
    return ScpiSwitch(host, port, _matrix_ports(config))


def _address(url: str) -> tuple[str, int]:
    try:
        parts = urlsplit(url)
        port = SCPI_PORT if parts.port is None else parts.port
    except ValueError as error:
        raise BadConfig(f"hardware {url!r}: {error}") from error
    extra = parts.path or parts.query or parts.fragment or parts.username
    if parts.scheme != "scpi" or not parts.hostname or not port or extra:
        raise BadConfig(
            f"hardware {url!r} is not known; leave it empty for the simulated switch or write "
            "scpi://HOST:PORT"
        )
    return parts.hostname, port


def _matrix_ports(config: AgentConfig) -> dict[int, MatrixPort]:
    ports: dict[int, MatrixPort] = {}
    used: set[int] = set()
    for port in config.fiber_ports:
        numbers = config.hardware_ports.get(str(port))
        if not isinstance(numbers, list) or len(numbers) != 2 or not all(map(_is_port, numbers)):
            raise BadConfig(
                f"hardware_ports of fibre port {port} are {numbers!r}; name the instrument's "
                "numbers, as in [1, 17] for ingress 1 and egress 17"
            )
        if taken := used & set(numbers) or set(numbers[:1]) & set(numbers[1:]):
            raise BadConfig(f"hardware_ports name port {min(taken)} of the instrument twice")
        used |= set(numbers)
        ports[port] = MatrixPort(*numbers)
    unknown = sorted(config.hardware_ports.keys() - {str(port) for port in ports})
    if unknown:
        raise BadConfig(f"hardware_ports name port {unknown[0]!r}, where no fibre ends")
    return ports


def _is_port(number: object) -> bool:
    return isinstance(number, int) and not isinstance(number, bool) and number > 0
