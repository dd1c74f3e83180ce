"""Wireshark's fields of the messages of key distribution, and the script that reads them."""

from dataclasses import fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

from applications.qkd import messages as qkd
from applications.qkd.messages import QkdMessage
from views.dissection.dissectors import layout_table
from views.dissection.layout import PACKED, TEXT, Enums, Layout, Tail, placed
from wire.metadata.values import Topic

LUA = Path(__file__).with_name("keys.lua")
KEY_ENUMS: Enums = MappingProxyType(
    {
        "bound": qkd.Bound,
        "reconciliation": qkd.Reconciliation,
        "reason": qkd.AbortReason,
    }
)


def tables() -> dict[str, Any]:
    return {
        "magic": qkd.MAGIC,
        "version": qkd.VERSION,
        "topic": Topic.KEYS,
        "header": qkd.HEADER.size,
        "tag": qkd.TAG_BYTES,
        "max_length": qkd.MAX_LENGTH,
        "max_text": qkd.MAX_TEXT,
        "max_mean": qkd.MAX_MEAN,
        "ranges": {
            kind.__name__: {
                name: {"least": least, "most": most} for name, (least, most) in kind.RANGES.items()
            }
            for kind in qkd.KINDS.values()
        },
        "kinds": [layout_table(layout) for layout in key_layouts()],
    }


def key_layouts() -> list[Layout]:
    """Return the kinds of messages of key distribution; their fields stand behind its header."""
    return [_key_layout(kind) for kind in qkd.KINDS.values()]


def _key_layout(kind: type[QkdMessage]) -> Layout:
    tails = tuple(
        Tail(packed.name, PACKED, count=packed.count, width=packed.width) for packed in kind.PACKED
    )
    if kind is qkd.Abort:
        tails = (Tail("text", TEXT),)
    variable = {tail.name for tail in tails}
    names = [item.name for item in fields(kind) if item.name not in variable]
    fixed = placed(kind.FIELDS, names, KEY_ENUMS)
    return Layout(kind.__name__, kind.KIND, kind.FIELDS.size, fixed, tails)
