"""The QNIC that a host's configuration names: the simulated one, or a class of the user's own.

Such a class is made with what SimulatedQnic takes (the dispatcher's address, the host's token, the
names of its fibres' interfaces) and keywords of its own, and has every method of Qnic, and close.
Its file comes from whoever starts the network, as the topology does; nothing that comes over the
network ever names one.
"""

import importlib.util
from pathlib import Path
from typing import Any, Protocol, cast

from hosts.hardware.qnic import Qnic
from hosts.hardware.simulated import SimulatedQnic
from wire.config import BadConfig, HostConfig


class ClosableQnic(Qnic, Protocol):
    """A QNIC as the program of a host needs it."""

    async def close(self) -> None:
        """Let go of the hardware."""


def chosen_qnic(config: HostConfig) -> ClosableQnic:
    """Return the hardware of a host; raise BadConfig for a class that cannot be it."""
    made_with = config.dispatcher, config.token, config.qnics
    if not config.qnic:
        if config.qnic_parameters:
            raise BadConfig("qnic_parameters are given without qnic; name the class, too")
        return SimulatedQnic(*made_with)
    file, _, name = config.qnic.rpartition(":")
    kind: Any = getattr(_module(config.qnic, Path(file)), name, None)
    if not isinstance(kind, type):
        raise BadConfig(f"qnic {config.qnic}: {file} has no class {name}")
    needed = {each for each in vars(Qnic) if not each.startswith("_")} | {"close"}
    if missing := sorted(each for each in needed if not hasattr(kind, each)):
        text = f"qnic {config.qnic}: {name} has no {', '.join(missing)}"
        raise BadConfig(f"{text}; see hosts/hardware/qnic.py")
    try:
        return cast(ClosableQnic, kind(*made_with, **config.qnic_parameters))
    except (TypeError, ValueError) as error:
        raise BadConfig(f"qnic {config.qnic} with {config.qnic_parameters}: {error}") from error


def _module(reference: str, file: Path) -> object:
    spec = importlib.util.spec_from_file_location(f"qnic_{file.stem}", file)
    if spec is None or spec.loader is None or not file.is_file():
        raise BadConfig(f"qnic {reference}: {file} is not a Python file on this machine")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (ImportError, SyntaxError, NameError, OSError) as error:
        raise BadConfig(f"qnic {reference}: {file} cannot be loaded: {error}") from error
    return module
