"""Make a quantum switch of the running network faulty, or repair it: `qmn set fault`."""

import argparse
from dataclasses import dataclass

from qmn.changes.change import BadChange, ask_dispatcher, reported
from qmn.options import read
from qmn.running.network import dispatcher_of_running_network
from qmn.timeouts import ORDER_TIMEOUT_S
from wire.config import DispatcherConfig, QuantumSwitch
from wire.dispatcher_pb2 import Connection, InjectFaultRequest
from wire.parameters.checks import remedy


@dataclass(frozen=True)
class Stuck:
    """A cross-connect that nothing can change, by OpenFlow port numbers."""

    in_port: int
    out_port: int


@dataclass(frozen=True)
class Temperature:
    temperature_c: float


@dataclass(frozen=True)
class Failed:
    """A part of the switch that does nothing any more, by one of its OpenFlow ports."""

    port: int


@dataclass(frozen=True)
class Repair:
    """Nothing is stuck or has failed any more, and the temperature is as it was."""


Fault = Stuck | Temperature | Failed | Repair
FAULTS: dict[str, type[Fault]] = {
    "stuck": Stuck,
    "temperature": Temperature,
    "failed": Failed,
    "repair": Repair,
}


def describe(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("switch", metavar="SWITCH", help="its name, as q1")
    kinds = parser.add_subparsers(dest="kind", metavar="FAULT", required=True)
    text = "a cross-connect is made now, and nothing can change it"
    stuck = kinds.add_parser("stuck", help=text, description=text)
    stuck.add_argument("in_port", metavar="IN_PORT", type=int, help="OpenFlow port number")
    stuck.add_argument("out_port", metavar="OUT_PORT", type=int, help="OpenFlow port number")
    text = "the switch has this temperature; above its limit every path loses more"
    temperature = kinds.add_parser("temperature", help=text, description=text)
    temperature.add_argument("temperature_c", type=float, metavar="CELSIUS", help="of the switch")
    text = "an analyser, memory or source takes in and gives no light any more"
    failed = kinds.add_parser("failed", help=text, description=text)
    failed.add_argument("port", metavar="PORT", type=int, help="OpenFlow port number, from 60001")
    text = "nothing is stuck or has failed any more, and the temperature is as it was"
    kinds.add_parser("repair", help=text, description=text)
    parser.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    fault = read(FAULTS[arguments.kind], arguments)
    return reported(lambda: inject(dispatcher_of_running_network(), arguments.switch, fault))


def inject(config: DispatcherConfig, name: str, fault: Fault) -> str:
    """Ask the dispatcher for the fault of a switch; return the outcome in words."""
    switch = find_switch(config, name)
    deadline_s = ORDER_TIMEOUT_S + switch.switching_time_s
    request = build_request(config, name, fault)
    ask_dispatcher(config, "InjectFault", request, deadline_s, takes_time=True)
    return outcome(switch, fault)


def find_switch(config: DispatcherConfig, name: str) -> QuantumSwitch:
    """Raise BadChange, which lists the switches, for an unknown name."""
    switches = {switch.name: switch for switch in config.switches}
    if name not in switches:
        raise BadChange(f"unknown quantum switch {name!r}: {remedy(name, sorted(switches))}")
    return switches[name]


def build_request(config: DispatcherConfig, name: str, fault: Fault) -> InjectFaultRequest:
    """Raise BadChange for a port without a fibre."""
    if isinstance(fault, Repair):
        return InjectFaultRequest(switch=name, repair=True)
    if isinstance(fault, Temperature):
        return InjectFaultRequest(switch=name, temperature_c=fault.temperature_c)
    if isinstance(fault, Failed):
        inner = find_switch(config, name).inner_ports
        if fault.port not in inner:
            known = ", ".join(map(str, inner)) or "none"
            text = f"port {fault.port} of {name} is not an inner port"
            raise BadChange(f"{text}: choose one of {known}")
        return InjectFaultRequest(switch=name, failed=fault.port)
    ends = [end for fiber in config.fibers for end in (fiber.a, fiber.b)]
    ports = sorted(int(end.port) for end in ends if end.node == name)
    for port in (fault.in_port, fault.out_port):
        if port not in ports:
            known = ", ".join(map(str, ports)) or "none"
            raise BadChange(f"port {port} of {name} has no fibre: choose one of {known}")
    connection = Connection(in_port=fault.in_port, out_port=fault.out_port)
    return InjectFaultRequest(switch=name, stuck=connection)


def outcome(switch: QuantumSwitch, fault: Fault) -> str:
    if isinstance(fault, Repair):
        return f"{switch.name}: repaired, {switch.temperature_c:g} C"
    if isinstance(fault, Failed):
        return f"{switch.name}: {switch.inner_ports[fault.port].node(switch.name)} has failed"
    if isinstance(fault, Stuck):
        return f"{switch.name}: cross-connect {fault.in_port} -> {fault.out_port} is stuck"
    hot = fault.temperature_c > switch.max_temperature_c
    limit = f"{switch.max_temperature_c:g} C"
    effect = f"above its limit of {limit}: every path loses {switch.hot_loss_db:g} dB more"
    return (
        f"{switch.name}: {fault.temperature_c:g} C, "
        f"{effect if hot else f'within its limit of {limit}'}"
    )
