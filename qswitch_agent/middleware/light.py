"""The limits of light: a FLOW_MOD may ask for nothing beyond them.

Light carries no headers and cannot be copied: a light entry matches one fibre port and
nothing else, in table 0, and sends what comes in there to one other fibre port, or nowhere.
On a fibre's supervisory channel LLDP passes, and only to the controller.
"""

from collections.abc import Callable, Iterable

from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import matches, refusals
from qswitch_agent.openflow.flows import FlowMod
from qswitch_agent.openflow.instructions import ACTION_LISTS, KNOWN, Instructions
from qswitch_agent.openflow.refusals import Refusal

MODIFYING = (ofp.OFPFC_MODIFY, ofp.OFPFC_MODIFY_STRICT)
PUTTING = (ofp.OFPFC_ADD, *MODIFYING)


def is_light(mod: FlowMod, fibers: frozenset[int]) -> bool:
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
    in_port = matches.in_port(mod.fields)
    if in_port not in fibers:
        _require_classical(mod.instructions.outputs, fibers)
        return False
    if matches.is_lldp(mod.fields):
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
    _require_one_way(mod.instructions, in_port, fibers)
    return True


def require_no_fiber(ports: Iterable[int], fibers: frozenset[int]) -> None:
    """Raise Refusal if packets shall go into a fibre."""
    _require_classical(ports, fibers)


def _require_classical(outputs: Iterable[int], fibers: frozenset[int]) -> None:
    for port in outputs:
        if port in fibers:
            raise refusals.bad_out_port(f"packets cannot go into the fibre at port {port}")


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
    instructions: Instructions, in_port: int | None, fibers: frozenset[int]
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
        if port not in fibers or port == in_port:
            raise refusals.bad_out_port(f"light of port {in_port} cannot leave by port {port:#x}")
    if len(outputs) > 1:
        raise refusals.too_many_actions(
            f"light of port {in_port} cannot be copied to {len(outputs)} ports",
        )
