"""Key links of light as the controller tells of them, in the words of ETSI GS QKD 015."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class KeyLink:
    from_: str
    to: str
    keys_ready: int  # at this end
    keys_ready_there: int
    max_key_count: int  # of both, that a store of its has room for
    key_bits_per_s: int
    qber: float | None  # None before the first session
    state: str  # "active" or "off"


def key_links(nodes: list[dict[str, Any]]) -> Iterator[KeyLink]:
    """Yield the links of SD-QKD nodes; those by way of other hosts are left out."""
    for node in nodes:
        for link in node["qkd_links"]["qkd_link"]:
            if link["qkdl_type"] != "PHYS":
                continue
            details, performance = link["qmn"], link["qkdl_performance"]
            here, there = details["stored_keys"]
            values = [each["value"] for each in performance.get("phys_perf", ())]
            yield KeyLink(
                details["from"],
                details["to"],
                here,
                there,
                details["max_key_count"],
                performance["skr"],
                values[0] if values else None,
                link["qkdl_status"].lower(),
            )
