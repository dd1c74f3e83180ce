"""The checks of a request about light before the bridge hears of it, alone or in a bundle."""

from qswitch_agent.middleware.flow_table import concerns
from qswitch_agent.middleware.light import MODIFYING, is_light, require_no_fiber
from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import packets, refusals
from qswitch_agent.openflow.flows import FlowMod
from qswitch_agent.openflow.instructions import Mark
from qswitch_agent.openflow.ports import PortMod
from qswitch_agent.proxy.bundles import Tunings
from qswitch_agent.proxy.link import Link
from qswitch_agent.switch import Switch

ALL_CONFIG = ofp.OFPPC_PORT_DOWN | ofp.OFPPC_NO_RECV | ofp.OFPPC_NO_FWD | ofp.OFPPC_NO_PACKET_IN
CHANGEABLE = ofp.OFPPC_PORT_DOWN | ofp.OFPPC_NO_PACKET_IN


def require_not_slave(link: Link, request: str) -> None:
    """Raise Refusal for what the bridge would refuse as well, before it is taken in here."""
    if link.is_slave:
        raise refusals.slave(f"{request} of a slave")


def concerns_light(mod: FlowMod, switch: Switch) -> bool:
    """Tell whether a FLOW_MOD adds or modifies light entries; raise Refusal for what cannot be.

    A switch of light alone has one table, for what is said of packets there, too.
    """
    light = is_light(mod, switch.fibers)
    if switch.optical_alone and not mod.deletes:
        if mod.table:
            raise refusals.bad_table(
                f"table {mod.table} of a switch that has table 0 alone",
            )
        if ofp.OFPIT_GOTO_TABLE in mod.instructions.kinds:
            reason = "there is no further table to go to"
            raise refusals.unsupported_instruction(reason)
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
    """Return a PORT_MOD and how ports are to be tuned by it."""
    mod = PortMod.decode(message)
    if unknown := (mod.mask | mod.config) & ~ALL_CONFIG:
        raise refusals.bad_config(f"configuration bits {unknown:#x} mean nothing")
    if mod.number not in switch.fibers:
        if mod.number not in switch.ports:
            reason = f"there is no port {mod.number}"
            raise refusals.bad_port(reason)
        if mod.tuning:
            reason = f"port {mod.number} has no optics"
            raise refusals.bad_property(reason)
        return mod, []
    if mod.mask & ~CHANGEABLE:
        raise refusals.bad_config(
            f"configuration bits {mod.mask:#x} of a fibre: it can be down or send no packet-in"
        )
    return mod, [(mod.number, switch.tuning(mod.number, mod.tuning))] if mod.tuning else []


def require_no_light(group_mod: bytes, switch: Switch) -> None:
    """Raise Refusal for a new group if the switch has none, or if it would lead into a fibre."""
    if switch.optical_alone and packets.command(group_mod) == ofp.OFPGC_ADD:
        reason = "light has no groups"
        raise refusals.out_of_groups(reason)
    require_no_fiber(packets.group_outputs(group_mod), switch.fibers)


def require_meters(meter_mod: bytes, switch: Switch) -> None:
    """Raise Refusal for a new meter if the switch has none."""
    if switch.optical_alone and packets.command(meter_mod) == ofp.OFPMC_ADD:
        reason = "light has no meters"
        raise refusals.out_of_meters(reason)
