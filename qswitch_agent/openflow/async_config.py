"""SET_ASYNC and GET_ASYNC_REPLY as bytes: which removals of flow entries a controller hears of.

Light entries never expire in the bridge: the agent deletes those that are idle. So the bridge
is told to report deletions to whoever wants to hear of idle entries, and what the controller
did not ask for is left out on the way.
"""

import struct
from collections.abc import Iterator, Mapping

from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow.messages import HEADER, each_part, with_body

REASONS = struct.Struct(ofp.OFP_ASYNC_CONFIG_PROP_REASONS_PACK_STR)  # type, length, mask
SLAVE, MASTER = ofp.OFPACPT_FLOW_REMOVED_SLAVE, ofp.OFPACPT_FLOW_REMOVED_MASTER
IDLE, DELETED = 1 << ofp.OFPRR_IDLE_TIMEOUT, 1 << ofp.OFPRR_DELETE
ALL_REASONS = (1 << ofp.OFPRR_EVICTION + 1) - 1
DEFAULT = {SLAVE: 0, MASTER: ALL_REASONS}  # of a connection that has set nothing


def removal_masks(message: bytes) -> dict[int, int]:
    masks = (REASONS.unpack(part) for part in _parts(message) if _is_removal(part))
    return {kind: mask for kind, _length, mask in masks}


def with_deletions(message: bytes) -> bytes:
    masks = removal_masks(message)
    wider = {kind: mask | (DELETED if mask & IDLE else 0) for kind, mask in masks.items()}
    return with_removal_masks(message, wider)


def with_removal_masks(message: bytes, masks: Mapping[int, int]) -> bytes:
    return with_body(message, b"".join(_with_mask(part, masks) for part in _parts(message)))


def _parts(message: bytes) -> Iterator[bytes]:
    return (body for _kind, body in each_part(message[HEADER.size :], 4, "property"))


def _is_removal(part: bytes) -> bool:
    return int.from_bytes(part[:2], "big") in (SLAVE, MASTER) and len(part) == REASONS.size


def _with_mask(part: bytes, masks: Mapping[int, int]) -> bytes:
    if not _is_removal(part):
        return part
    kind, length, mask = REASONS.unpack(part)
    return REASONS.pack(kind, length, masks.get(kind, mask))
