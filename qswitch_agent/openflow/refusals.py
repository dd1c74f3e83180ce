"""The refusals that a controller's request can meet, each with the OpenFlow error that answers it.

raise refusals.bad_out_port(f"there is no port {number}")
"""

from functools import partial

from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow.messages import MalformedPart
from wire.malformed import MalformedPacket


class Refusal(Exception):
    """A message that is answered with an OpenFlow error: its type, code and reason."""

    def __init__(self, kind: int, code: int, reason: str) -> None:
        super().__init__(reason)
        self.kind = kind
        self.code = code


# Requests
slave = partial(Refusal, ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_IS_SLAVE)
bad_length = partial(Refusal, ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_BAD_LEN)
bad_experiment = partial(Refusal, ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_BAD_EXP_TYPE)

# Actions and instructions
bad_out_port = partial(Refusal, ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT)
bad_out_group = partial(Refusal, ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_GROUP)
bad_action = partial(Refusal, ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_TYPE)
too_many_actions = partial(Refusal, ofp.OFPET_BAD_ACTION, ofp.OFPBAC_TOO_MANY)
unsupported_instruction = partial(Refusal, ofp.OFPET_BAD_INSTRUCTION, ofp.OFPBIC_UNSUP_INST)
unknown_instruction = partial(Refusal, ofp.OFPET_BAD_INSTRUCTION, ofp.OFPBIC_UNKNOWN_INST)
bad_experimenter = partial(Refusal, ofp.OFPET_BAD_INSTRUCTION, ofp.OFPBIC_BAD_EXPERIMENTER)

# Flow entries
bad_field = partial(Refusal, ofp.OFPET_BAD_MATCH, ofp.OFPBMC_BAD_FIELD)
bad_mask = partial(Refusal, ofp.OFPET_BAD_MATCH, ofp.OFPBMC_BAD_MASK)
bad_command = partial(Refusal, ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_BAD_COMMAND)
not_permitted = partial(Refusal, ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_EPERM)
bad_table = partial(Refusal, ofp.OFPET_FLOW_MOD_FAILED, ofp.OFPFMFC_BAD_TABLE_ID)

# Ports
bad_port = partial(Refusal, ofp.OFPET_PORT_MOD_FAILED, ofp.OFPPMFC_BAD_PORT)
bad_config = partial(Refusal, ofp.OFPET_PORT_MOD_FAILED, ofp.OFPPMFC_BAD_CONFIG)
bad_address = partial(Refusal, ofp.OFPET_PORT_MOD_FAILED, ofp.OFPPMFC_BAD_HW_ADDR)
bad_value = partial(Refusal, ofp.OFPET_BAD_PROPERTY, ofp.OFPBPC_BAD_VALUE)
bad_property = partial(Refusal, ofp.OFPET_BAD_PROPERTY, ofp.OFPBPC_BAD_TYPE)

# Groups and meters
out_of_groups = partial(Refusal, ofp.OFPET_GROUP_MOD_FAILED, ofp.OFPGMFC_OUT_OF_GROUPS)
out_of_meters = partial(Refusal, ofp.OFPET_METER_MOD_FAILED, ofp.OFPMMFC_OUT_OF_METERS)

# Bundles
bad_xid = partial(Refusal, ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_MSG_BAD_XID)
out_of_bundles = partial(Refusal, ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_OUT_OF_BUNDLES)
bundles_too_large = partial(Refusal, ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_MSG_TOO_MANY)
not_in_a_bundle = partial(Refusal, ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_MSG_UNSUP)
bundle_failed = partial(Refusal, ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_MSG_FAILED)


def of_malformed(error: MalformedPacket) -> Refusal:
    if isinstance(error, MalformedPart):
        return Refusal(error.kind, error.code, str(error))
    return bad_length(str(error))
