"""The part of a result that a run with bytes adds: the message, and what it took."""

from collections.abc import Mapping
from hashlib import file_digest
from pathlib import Path
from typing import Any

from wire.device import RANGES, setting_name
from wire.results.run_result import Message, MessageJob, Received, Sent

RECEIVED = "received"  # in the folder of the run
COUNTS = (
    *("bell_pairs", "lost_pairs", "repeated_frames", "received_symbols", "symbol_errors"),
    *("corrected_symbols", "filled_symbols"),
)


def message(file: str, folder: Path) -> Message:
    """Return what a run has made of a file: the digests of what was sent and of what came."""
    sent = Path(file)
    return Message(file, sent.stat().st_size, sha256(sent), sha256(folder / RECEIVED))


def sent(told: Mapping[str, Any], time_scale: float) -> Sent:
    """Return what the sending application has said, whose seconds are those of the wall."""
    counts = {name: int(told.get(name, 0)) for name in COUNTS}
    errors, symbols = counts["symbol_errors"], counts["received_symbols"]
    in_use = {name: setting_name(name, told[name]) for name in RANGES if name in told}
    elapsed_s = told.get("elapsed_s", 0.0) / time_scale
    return Sent(
        **counts,
        symbol_error_rate=errors / symbols if symbols else None,
        in_use=in_use or None,
        code_rate=told.get("code_rate"),
        bell_states=told.get("symbols"),
        elapsed_s=elapsed_s,
        pairs_per_s=counts["bell_pairs"] / elapsed_s if elapsed_s else 0.0,
    )


def received(told: Mapping[str, Any]) -> Received:
    """Return what the receiving application has said."""
    return Received(told.get("confusion"))


def sha256(file: Path) -> str | None:
    """Return the digest of a file, None if there is none."""
    if not file.exists():
        return None
    with file.open("rb") as opened:
        return file_digest(opened, "sha256").hexdigest()


def rows(job: MessageJob) -> dict[str, str]:
    """Return what a person is told of the message."""
    message, told = job.message, job.asking
    rate = told.symbol_error_rate
    outcome = "delivered exactly" if message.arrived else "NOT DELIVERED"
    return {
        "message": f"{message.bytes:,} bytes, {outcome}",
        "Bell pairs used": f"{told.bell_pairs:,}",
        "pairs lost": f"{told.lost_pairs:,}",
        "symbol error rate": "no symbol received" if rate is None else f"{rate:.4g}",
        **coding(told),
        "repeated frames": f"{told.repeated_frames:,}",
        "pairs/s": f"{told.pairs_per_s:,.0f} ({told.elapsed_s or 0.0:.2f} s)",
    }


def coding(told: Sent) -> dict[str, str]:
    """Return the lines about the error-correction code; none if there was no code."""
    in_use = told.in_use or {}
    if in_use.get("fec", "none") == "none":
        return {}
    order = "interleaved" if in_use["interleave"] == "on" else "not interleaved"
    return {
        "code": f"{in_use['fec']}, {order}, rate {told.code_rate:.3f}",
        "put right by it": f"{told.corrected_symbols:,} wrong symbols, "
        f"{told.filled_symbols:,} lost ones",
    }
