"""The checks of a request about light before the bridge hears of it, alone or in a bundle.

The limits of light: a FLOW_MOD may ask for nothing beyond them.

Light carries no headers and cannot be copied: a light entry matches one fibre port, or a memory's,
and nothing else, in table 0, and sends what comes in there to one other fibre port, to an inner
port of the switch, or nowhere.
On a fibre's supervisory channel LLDP passes, and only to the controller. Frames of an inner port
are packets, which match the port and their type.
"""

from collections.abc import Callable, Iterable

from qswitch_agent.middleware.flow_table import FlowTable, concerns
from qswitch_agent.middleware.optical_ports import Tuned
from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import matches, packets, refusals
from qswitch_agent.openflow.flows import FlowMod
from qswitch_agent.openflow.instructions import ACTION_LISTS, KNOWN, Instructions, Mark
from qswitch_agent.openflow.ports import PortMod
from qswitch_agent.openflow.refusals import Refusal
from qswitch_agent.proxy.bundles import Tunings
from qswitch_agent.proxy.link import Link
from qswitch_agent.switch import Switch
from wire.analyser_frames import ETHER_TYPE, HERALDS
from wire.parameters.switch import FIRST_INNER_PORT, Kind, inner_port

MODIFYING = (ofp.OFPFC_MODIFY, ofp.OFPFC_MODIFY_STRICT)
PUTTING = (ofp.OFPFC_ADD, *MODIFYING)


def is_light(mod: FlowMod, table: FlowTable) -> bool:
    """Tell whether a FLOW_MOD adds or modifies light entries.

    Raise Refusal, with the fitting OpenFlow error, if it asks for what light cannot do.
    """
    if mod.deletes:
        return False
    if mod.command not in PUTTING:
        raise refusals.bad_command(
            f"there is no command {mod.command}",
        )
    if matches.in_port_is_masked(mod.fields):
        raise refusals.bad_mask(
            "in_port cannot be matched by some of its bits",
        )
    in_port, outputs = matches.in_port(mod.fields), table.outputs
    frames = any(matches.is_of_type(mod.fields, kind) for kind in (ETHER_TYPE, HERALDS))
    if in_port not in table.inputs or (frames and in_port in table.inner):
        require_no_fiber(mod.instructions.outputs, table.light)
        return False
    if in_port in table.fibers and matches.is_of_type(mod.fields, matches.LLDP):
        _require_supervisory(mod.instructions)
        return False
    if mod.table != 0:
        raise refusals.bad_table(
            f"light of port {in_port} in table {mod.table}; its entries are in table 0",
        )
    if set(mod.fields) != {matches.IN_PORT}:
        raise refusals.bad_field(
            f"light of port {in_port} carries no headers: match in_port alone",
        )
    _require_one_way(mod.instructions, in_port, outputs)
    return True


def require_no_fiber(ports: Iterable[int], light: frozenset[int]) -> None:
    """Raise Refusal if packets shall go where only light goes."""
    for port in ports:
        if port in light:
            where = "inner port" if port >= FIRST_INNER_PORT else "fibre at port"
            raise refusals.bad_out_port(f"packets cannot go into the {where} {port}")


def _require_supervisory(instructions: Instructions) -> None:
    to_controller = set(instructions.outputs) <= {ofp.OFPP_CONTROLLER}
    if not to_controller or any(kind != ofp.OFPAT_OUTPUT for kind, _ in instructions.actions):
        raise refusals.bad_out_port("LLDP of a fibre goes to the controller and nowhere else")
    _require_action_lists(instructions)


def _require_action_lists(instructions: Instructions) -> None:
    for kind in instructions.kinds:
        if kind not in ACTION_LISTS:
            refused = _unfit(kind)
            raise refused(f"instruction {kind}: light is sent out of a port, no more")


def _unfit(instruction: int) -> Callable[[str], Refusal]:
    if instruction == ofp.OFPIT_EXPERIMENTER:
        return refusals.bad_experimenter
    return (
        refusals.unsupported_instruction if instruction in KNOWN else refusals.unknown_instruction
    )


def _require_one_way(
    instructions: Instructions, in_port: int | None, light: frozenset[int]
) -> None:
    _require_action_lists(instructions)
    for kind, _action in instructions.actions:
        if kind == ofp.OFPAT_GROUP:
            raise refusals.bad_out_group("light cannot go to a group")
        if kind != ofp.OFPAT_OUTPUT:
            raise refusals.bad_action(
                f"action {kind}: light carries nothing that could be changed",
            )
    outputs = instructions.outputs
    for port in outputs:
        if port not in light or port == in_port:
            raise refusals.bad_out_port(f"light of port {in_port} cannot leave by port {port:#x}")
    if len(outputs) > 1:
        raise refusals.too_many_actions(
            f"light of port {in_port} cannot be copied to {len(outputs)} ports",
        )


ALL_CONFIG = ofp.OFPPC_PORT_DOWN | ofp.OFPPC_NO_RECV | ofp.OFPPC_NO_FWD | ofp.OFPPC_NO_PACKET_IN
CHANGEABLE = ofp.OFPPC_PORT_DOWN | ofp.OFPPC_NO_PACKET_IN


def require_not_slave(link: Link, request: str) -> None:
    """Raise Refusal for what the bridge would refuse as well, before it is taken in here."""
    if link.is_slave:
        raise refusals.slave(f"{request} of a slave")


def concerns_light(mod: FlowMod, switch: Switch) -> bool:
    """Tell whether a FLOW_MOD adds or modifies light entries; raise Refusal for what cannot be.

    A switch of light alone has one table, also for entries on packets.
    """
    light = is_light(mod, switch.paths.table)
    if light:
        switch.require_seen(mod.cookie)
    if switch.optical_alone and not mod.deletes:
        if mod.table:
            raise refusals.bad_table(
                f"table {mod.table} of a switch that has table 0 alone",
            )
        if ofp.OFPIT_GOTO_TABLE in mod.instructions.kinds:
            raise refusals.unsupported_instruction("there is no further table to go to")
    return light


def may_modify_light(mod: FlowMod) -> bool:
    return mod.command in MODIFYING and len(mod.fields) <= 1


def marked(mod: FlowMod, switch: Switch, link: Link) -> FlowMod:
    """Return an ADD with a mark; an entry that takes another's place counts on from there."""
    before = switch.paths.table.find(mod.priority, mod.match)
    if mod.flags & ofp.OFPFF_RESET_COUNTS or any(
        before and concerns(deletion, before) for deletion in link.deletions
    ):
        before = None
    circuit = before.mark.circuit if before and before.mark else 0
    return mod.marked(Mark(mod.idle_timeout_s, circuit or switch.new_circuit()))


def checked_port_mod(message: bytes, switch: Switch) -> tuple[PortMod, Tunings]:
    mod = PortMod.decode(message)
    if unknown := (mod.mask | mod.config) & ~ALL_CONFIG:
        raise refusals.bad_config(f"configuration bits {unknown:#x} mean nothing")
    memory = mod.number in switch.inner and inner_port(mod.number).kind == Kind.MEMORY
    if mod.cutoff_s is not None and not (memory and mod.cutoff_s):
        raise refusals.bad_property(f"a cut-off of {mod.cutoff_s:g} s at port {mod.number}")
    if mod.number not in switch.fibers:
        if mod.number not in switch.ports:
            raise refusals.bad_port(f"there is no port {mod.number}")
        if mod.tuning:
            raise refusals.bad_property(f"port {mod.number} has no optics")
        down = bool(mod.config & ofp.OFPPC_PORT_DOWN)
        sets_down = mod.number in switch.inner and mod.mask & ofp.OFPPC_PORT_DOWN
        tuned = Tuned(None, None, cutoff_s=mod.cutoff_s, down=down if sets_down else None)
        return mod, [(mod.number, tuned)] if tuned != Tuned(None, None) else []
    if mod.mask & ~CHANGEABLE:
        raise refusals.bad_config(
            f"configuration bits {mod.mask:#x} of a fibre: it can be down or send no packet-in"
        )
    return mod, [(mod.number, switch.tuning(mod.number, mod.tuning))] if mod.tuning else []


def require_no_light(group_mod: bytes, switch: Switch) -> None:
    """Raise Refusal for a new group if the switch has none, or if it would lead into a fibre."""
    if switch.optical_alone and packets.command(group_mod) == ofp.OFPGC_ADD:
        raise refusals.out_of_groups("light has no groups")
    require_no_fiber(packets.group_outputs(group_mod), switch.light_ports)


def require_meters(meter_mod: bytes, switch: Switch) -> None:
    """Raise Refusal for a new meter if the switch has none."""
    if switch.optical_alone and packets.command(meter_mod) == ofp.OFPMC_ADD:
        raise refusals.out_of_meters("light has no meters")
