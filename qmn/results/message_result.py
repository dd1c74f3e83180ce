"""The part of a result that a run with bytes adds: the message, and what it took."""

from hashlib import file_digest
from pathlib import Path

from qmn.results.schema import RunFacts
from wire.device import RANGES, setting_name

RECEIVED = "received"  # in the folder of the run


def complete(facts: RunFacts, folder: Path) -> None:
    """Put what both ends have said, and the digests of the bytes, in the place of their lines."""
    sender, receiver = facts.pop("asking", {}), facts.pop("asked", {})
    sent, received = Path(facts["file"]), folder / RECEIVED
    facts["message_bytes"] = sent.stat().st_size
    facts["sha256_sent"] = sha256(sent)
    facts["sha256_received"] = sha256(received)
    facts["delivered"] = facts["sha256_sent"] == facts["sha256_received"]
    facts["bell_pairs"] = sender.get("bell_pairs", 0)
    facts["lost_pairs"] = sender.get("lost_pairs", 0)
    facts["repeated_frames"] = sender.get("repeated_frames", 0)
    facts["symbol_errors"] = sender.get("symbol_errors", 0)
    facts["corrected_symbols"] = sender.get("corrected_symbols", 0)
    facts["filled_symbols"] = sender.get("filled_symbols", 0)
    symbols = sender.get("received_symbols", 0)
    facts["symbol_error_rate"] = facts["symbol_errors"] / symbols if symbols else None
    in_use = {name: setting_name(name, sender[name]) for name in RANGES if name in sender}
    facts["in_use"] = in_use or None
    facts["code_rate"] = sender.get("code_rate")
    facts["bell_states"] = sender.get("symbols")  # that the receiver's analyser tells apart
    facts["confusion"] = receiver.get("confusion")
    elapsed_s = sender.get("elapsed_s", 0.0)  # the application measures by the wall
    facts["elapsed_s"] = elapsed_s / facts.get("time_scale", 1.0)
    facts["pairs_per_s"] = facts["bell_pairs"] / facts["elapsed_s"] if sender else 0.0


def sha256(file: Path) -> str | None:
    """Return the digest of a file, None if there is none."""
    if not file.exists():
        return None
    with file.open("rb") as opened:
        return file_digest(opened, "sha256").hexdigest()


def rows(facts: RunFacts) -> dict[str, str]:
    """Return what a person is told of the message."""
    rate = facts["symbol_error_rate"]
    outcome = "delivered exactly" if facts["delivered"] else "NOT DELIVERED"
    return {
        "message": f"{facts['message_bytes']:,} bytes, {outcome}",
        "Bell pairs used": f"{facts['bell_pairs']:,}",
        "pairs lost": f"{facts['lost_pairs']:,}",
        "symbol error rate": "no symbol received" if rate is None else f"{rate:.4g}",
        **coding(facts),
        "repeated frames": f"{facts['repeated_frames']:,}",
        "pairs/s": f"{facts['pairs_per_s']:,.0f} ({facts['elapsed_s']:.2f} s)",
    }


def coding(facts: RunFacts) -> dict[str, str]:
    """Return the lines about the error-correction code; none if there was no code."""
    in_use = facts["in_use"] or {}
    if in_use.get("fec", "none") == "none":
        return {}
    order = "interleaved" if in_use["interleave"] == "on" else "not interleaved"
    return {
        "code": f"{in_use['fec']}, {order}, rate {facts['code_rate']:.3f}",
        "put right by it": f"{facts['corrected_symbols']:,} wrong symbols, "
        f"{facts['filled_symbols']:,} lost ones",
    }
