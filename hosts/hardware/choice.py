"""The QNIC that a host's configuration names: the simulated one, or a class of the user's own.

Such a class is a subclass of Qnic. It is made with what SimulatedQnic takes (the dispatcher's
address, the host's token, the names of its fibres' interfaces) and keywords of its own.
"""

from hosts.hardware.qnic import Qnic
from hosts.hardware.simulated import SimulatedQnic
from programs.custom_class import load_class
from wire.config import BadConfig, HostConfig


def chosen_qnic(config: HostConfig) -> Qnic:
    """Return the hardware of a host; raise BadConfig for a class that cannot be it."""
    made_with = config.dispatcher, config.token, config.qnics
    if not config.qnic:
        if config.qnic_parameters:
            raise BadConfig("qnic_parameters are given without qnic; name the class, too")
        return with_credentials(SimulatedQnic(*made_with), config)
    kind = load_class("qnic", config.qnic)
    if problem := _problem(kind):
        raise BadConfig(f"qnic {config.qnic}: {kind.__name__} {problem}")
    try:
        made: Qnic = kind(*made_with, **config.qnic_parameters)
    except (TypeError, ValueError) as error:
        raise BadConfig(f"qnic {config.qnic} with {config.qnic_parameters}: {error}") from error
    if config.time_folder and not isinstance(made, SimulatedQnic):
        raise BadConfig(f"qnic {config.qnic} counts a time of its own: leave --time stepped out")
    return with_credentials(made, config)


def _problem(kind: type) -> str:
    """Return why a class cannot be a QNIC; empty if it can."""
    if not issubclass(kind, Qnic):
        return "is not a subclass of Qnic; derive it from hosts.hardware.qnic.Qnic"
    missing = ", ".join(sorted(kind.__abstractmethods__))
    return f"has no {missing}; see hosts/hardware/primitives.py" if missing else ""


def with_credentials(qnic: Qnic, config: HostConfig) -> Qnic:
    """Let a QNIC that asks the dispatcher do so by TLS, if hosts do."""
    if isinstance(qnic, SimulatedQnic):
        qnic.credentials, qnic.network_time = config.credentials, config.time
    return qnic
