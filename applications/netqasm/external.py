"""Our connection and sockets in the place of netqasm.sdk.external."""

import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from types import ModuleType

import netqasm.sdk.toolbox
from netqasm.runtime.settings import SIMULATOR_ENV, Simulator

from applications.netqasm import sim_states
from applications.netqasm.connection import Connection, get_qubit_state
from applications.netqasm.placement import Placement
from applications.netqasm.round_end import SOCKET, RoundEnd
from applications.netqasm.rounds import simulate_application
from applications.netqasm.text_format import NAME_BYTES
from applications.netqasm.texts import BroadcastChannel, Exchange, Socket
from applications.timeouts import ROUND_TIMEOUT_S

NAME, SIM_STATES = "netqasm.sdk.external", "netqasm.sdk.toolbox.sim_states"


@contextmanager
def installed(
    placement: Placement, on_round: Callable[[int], None] = lambda _number: None
) -> Iterator[Mapping[str, RoundEnd]]:
    """Let programs of the roles that run here use our network; yield the end of their rounds.

    If a program requests a simulation of an application, `on_round` hears the number of each round
    done.
    """
    for role in placement.hosts:
        if len(role.encode()) > NAME_BYTES:
            raise ValueError(f"role {role!r}: at most {NAME_BYTES} bytes")
    places = placement.addresses
    peers = frozenset(places.values())
    exchanges = {role: Exchange(role, places[role], peers) for role in placement.stacks}
    module = ModuleType(NAME, __doc__)
    sockets = {"placement": placement, "exchanges": exchanges}
    module.Socket = socket_type = type("Socket", (Socket,), sockets)  # type: ignore[attr-defined]
    ends = {role: _end(role, placement, socket_type) for role in placement.stacks}
    members = {"placement": placement, "ends": ends}
    module.NetQASMConnection = type("NetQASMConnection", (Connection,), members)  # type: ignore[attr-defined]
    channel = type("BroadcastChannel", (BroadcastChannel,), {"_socket_class": socket_type})
    module.BroadcastChannel = channel  # type: ignore[attr-defined]
    module.get_qubit_state = get_qubit_state  # type: ignore[attr-defined]
    module.simulate_application = partial(simulate_application, placement, on_round, ends)  # type: ignore[attr-defined]
    # Of the simulators that the SDK knows, the one whose own parts it never imports.
    os.environ.setdefault(SIMULATOR_ENV, Simulator.SIMULAQRON.value)
    netqasm.sdk.external, netqasm.sdk.toolbox.sim_states = module, sim_states
    replaced: dict[str, ModuleType] = {NAME: module, SIM_STATES: sim_states}
    before = {name: sys.modules.get(name) for name in replaced}
    sys.modules.update(replaced)
    try:
        yield ends
    finally:
        for name, original in before.items():
            del sys.modules[name]
            if original is not None:
                sys.modules[name] = original
        for exchange in exchanges.values():
            exchange.close()


def _end(role: str, placement: Placement, kind: type[Socket]) -> RoundEnd:
    others = [other for other in placement.hosts if other != role]
    return RoundEnd(others, lambda other: kind(role, other, SOCKET, ROUND_TIMEOUT_S))
