"""The files of a run that go to another machine, for a host on it, and come back.

Programs of the host read and write there what is in the run's private folder, by the same paths.
"""

from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

from mininet.log import warn

from topologies.system.machines.machine import Machine
from topologies.system.machines.packing import unpack
from topologies.system.processes.programs import NetworkError
from topologies.system.runs.runtime import Runtime
from wire.config import CarriedConfig, Config, HostConfig
from wire.credentials import secret_file


def carried(network: Runtime, name: str, config: Config, host: str, machine: Machine) -> Config:
    """Copy the files of a program to the machine of its host; return its configuration there.

    Raise NetworkError for a program that is on the first machine alone.
    """
    if isinstance(config, HostConfig):
        return _of_stack(network, name, config, machine)
    if isinstance(config, CarriedConfig):
        return _of_program(network, name, config, machine)
    raise NetworkError(f"{name} runs on the first machine alone: place {host} there")


def _of_stack(network: Runtime, name: str, config: HostConfig, machine: Machine) -> HostConfig:
    if config.qnic:
        raise NetworkError(f"{name}: hardware of one's own is on the first machine alone")
    shared = Path(config.pair_secrets)
    needed = [secret_file(shared, name, other) for other in network.addresses if other != name]
    if config.credentials is not None:
        needed += map(Path, astuple(config.credentials))
    for file in (Path(config.hosts_file), *needed):
        machine.put(file, file.read_bytes())
    for folder in (Path(config.socket).parent, shared, Path(config.keys)):
        machine.ask("folder", path=str(folder))
    _bring_keys(network, name, Path(config.keys), machine)
    machine.relay(config.socket)
    return config


def _bring_keys(network: Runtime, host: str, there: Path, machine: Machine) -> None:
    here = network.kept_keys(host)

    def bring() -> None:
        if machine.lost:
            warn(f"the keys of {host} were on {machine.name}, and are lost with it\n")
        else:
            unpack(machine.get_folder(there), here)

    if network.settings.keys:
        network.from_elsewhere.callback(bring)


def _of_program(
    network: Runtime, name: str, config: CarriedConfig, machine: Machine
) -> CarriedConfig:
    """Give it its files; what Wireshark reads by comes back at the end."""
    folder = network.folder / name

    def put(path: str) -> str:
        there = folder / Path(path).name
        machine.put(there, Path(path).read_bytes())
        return str(there)

    files: Any = {name: put(getattr(config, name)) for name in config.FILES}
    moved = replace(config, **files)
    if not config.key_log:
        return moved
    there, here = folder / "key-log", Path(config.key_log)
    machine.put(there, b"")
    network.from_elsewhere.callback(_bring, machine, there, here)
    return replace(moved, key_log=str(there))


def _bring(machine: Machine, there: Path, here: Path) -> None:
    """Write into a file here what is in one there, unless the machine is lost."""
    if not machine.lost and (data := machine.get(there)) is not None:
        here.write_bytes(data)
