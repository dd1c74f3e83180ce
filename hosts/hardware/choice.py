"""The QNIC that a host's configuration names: the simulated one, or a class of the user's own.

Such a class is made with what SimulatedQnic takes (the dispatcher's address, the host's token, the
names of its fibres' interfaces) and keywords of its own, and has every method of Qnic, and close.
"""

from typing import Protocol, cast

from hosts.hardware.qnic import Qnic
from hosts.hardware.simulated import SimulatedQnic
from programs.custom_class import load_class
from wire.config import BadConfig, HostConfig


class ClosableQnic(Qnic, Protocol):
    """A QNIC as the program of a host needs it."""

    async def close(self) -> None:
        """Close the hardware."""


def chosen_qnic(config: HostConfig) -> ClosableQnic:
    """Return the hardware of a host; raise BadConfig for a class that cannot be it."""
    made_with = config.dispatcher, config.token, config.qnics
    if not config.qnic:
        if config.qnic_parameters:
            raise BadConfig("qnic_parameters are given without qnic; name the class, too")
        return with_credentials(SimulatedQnic(*made_with), config)
    kind = load_class("qnic", config.qnic)
    needed = {each for each in vars(Qnic) if not each.startswith("_")} | {"close"}
    if missing := sorted(each for each in needed if not hasattr(kind, each)):
        text = f"qnic {config.qnic}: {kind.__name__} has no {', '.join(missing)}"
        raise BadConfig(f"{text}; see hosts/hardware/qnic.py")
    try:
        made = cast(ClosableQnic, kind(*made_with, **config.qnic_parameters))
    except (TypeError, ValueError) as error:
        raise BadConfig(f"qnic {config.qnic} with {config.qnic_parameters}: {error}") from error
    return with_credentials(made, config)


def with_credentials(qnic: ClosableQnic, config: HostConfig) -> ClosableQnic:
    if isinstance(qnic, SimulatedQnic):
        qnic.credentials = config.credentials
    return qnic
