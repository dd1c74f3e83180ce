"""Memories of a network that stands, as the options --device and --switch of a job say."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from qmn.network.description import NetworkDescription, describe_network
from qmn.options import from_keywords
from qmn.running.dispatcher_calls import adjust_memories
from topologies.description.description import Description
from topologies.networks.network import Network
from wire.config import ADJUSTED, HostConfig
from wire.parameters.physics import ADJUSTABLE, Memory

WORDS = "device", "switch"
OF_HOSTS = HostConfig.__dataclass_fields__.keys() & set(ADJUSTABLE)


def adjusted(
    network: Network, before: NetworkDescription, options: Mapping[str, Any]
) -> NetworkDescription:
    """Adjust memories; return the network as it is then, `before` if more is to change."""
    stands = before.options
    words = {name: options[name] for name in WORDS if name in options}
    if not words or not stands.topology or network.runtime.places:
        return before
    requested = from_keywords(type(stands), words, topology=stands.topology)
    wanted = replace(
        stands,
        device=behind(stands.device, requested.device),
        switch=behind(stands.switch, requested.switch),
    )
    if wanted == stands:
        return before
    after = describe_network(wanted)
    if _fixed(after.parts) != _fixed(before.parts):
        return before
    old, new = _memories(before.parts), _memories(after.parts)
    changed = {name: memory for name, memory in new.items() if memory != old[name]}
    adjust_memories(network, {name: _settings(memory) for name, memory in changed.items()})
    _note(network, after.parts)
    return replace(after, topo=before.topo, pace=before.pace)


def behind(stands: Iterable[str], words: Iterable[str]) -> tuple[str, ...]:
    """Return the words, behind those that stand and are of other settings."""
    settings = {word.partition("=")[0] for word in words}
    return (*(word for word in stands if word.partition("=")[0] not in settings), *words)


def _memories(parts: Description) -> dict[str, Memory]:
    of_switches = {name: switch.memory for name, switch in parts.switches.items()}
    return {name: device.memory for name, device in parts.hosts.items()} | of_switches


def _settings(memory: Memory) -> dict[str, float]:
    return {name: getattr(memory, name) for name in ADJUSTABLE}


def _fixed(parts: Description) -> Description:
    """Return all but what can be adjusted."""

    def fixed(part: Any) -> Any:
        return replace(part, memory=replace(part.memory, **_settings(Memory())))

    hosts = {name: fixed(device) for name, device in parts.hosts.items()}
    switches = {name: fixed(switch) for name, switch in parts.switches.items()}
    return replace(parts, hosts=hosts, switches=switches)


def _note(network: Network, parts: Description) -> None:
    """Tell stacks, and starters of programs."""
    runtime = network.runtime
    for name, switch in parts.switches.items():
        runtime.switches[name] = replace(runtime.switches[name], memory=switch.memory)
    for name, device in parts.hosts.items():
        runtime.devices[name] = device
        times = {field: getattr(device.memory, field) for field in OF_HOSTS}
        file = Path(runtime.socket(name)).with_suffix(ADJUSTED)
        (written := file.with_suffix(".new")).write_text(json.dumps(times))
        written.replace(file)  # whole, also for a session that begins now
