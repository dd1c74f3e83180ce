"""The facts of a run: result.json for programs, a short table for people."""

import json
import statistics
from hashlib import file_digest
from pathlib import Path
from typing import Any

from rich.console import Console

from qmn.results import software_share
from topologies.runtime import EVENT_LOG
from wire.controller_record import read_record
from wire.device import RANGES, setting_name

COUNTS = (
    "bell_pairs",
    "lost_pairs",
    "repeated_frames",
    "symbol_errors",
    "corrected_symbols",
    "filled_symbols",
)

EXACTNESS = {True: "exact", False: "with approximations", None: "exactness unknown"}


def complete(facts: dict[str, Any], folder: Path) -> None:
    """Add what the run has left in its folder, and write result.json."""
    sender = facts.pop("sender", {})
    sent, received = Path(facts["file"]), folder / "received"
    facts["message_bytes"] = sent.stat().st_size
    facts["sha256_sent"] = sha256(sent)
    facts["sha256_received"] = sha256(received)
    facts["delivered"] = facts["sha256_sent"] == facts["sha256_received"]
    for name in COUNTS:
        facts[name] = sender.get(name, 0)
    symbols = sender.get("received_symbols", 0)
    facts["symbol_error_rate"] = facts["symbol_errors"] / symbols if symbols else None
    in_use = {name: setting_name(name, sender[name]) for name in RANGES if name in sender}
    facts["in_use"] = in_use or None
    facts["code_rate"] = sender.get("code_rate")
    facts["bell_states"] = sender.get("symbols")  # that the receiver's analyser tells apart
    elapsed_s = sender.get("elapsed_s", 0.0)  # the application measures by the wall
    facts["elapsed_s"] = elapsed_s / facts.get("time_scale", 1.0)
    facts["pairs_per_s"] = facts["bell_pairs"] / facts["elapsed_s"] if sender else 0.0
    facts["emulation"] = emulation(facts, facts)
    facts.update(controller_facts(read_record(folder)))
    (folder / "result.json").write_text(json.dumps(facts, indent=2) + "\n")


def emulation(told: dict[str, Any], facts: dict[str, Any]) -> dict[str, float]:
    """Return how long it took here, and rates by the wall: the speed of the emulation."""
    scale = facts.get("time_scale", 1.0)  # a run that did not start has none
    rates = {name: rate / scale for name, rate in told.items() if name.endswith("_per_s") and rate}
    return {"elapsed_s": told.get("elapsed_s", 0.0) * scale, **rates}


def sha256(file: Path) -> str | None:
    """Return the digest of a file, None if there is none."""
    if not file.exists():
        return None
    with file.open("rb") as opened:
        return file_digest(opened, "sha256").hexdigest()


def controller_facts(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """Return path set-up times (ms) and packet-ins from the controller's record."""
    times = [line["setup_ms"] for line in lines if line["event"] == "path_ready"]
    counts = [line["packet_in_count"] for line in lines if "packet_in_count" in line]
    return {"path_setup_ms": percentiles(times), "packet_in_count": max(counts, default=0)}


def percentiles(times: list[float]) -> dict[str, Any]:
    """Return p50, p99 and n; None where there is nothing to tell."""
    if not times:
        return {"p50": None, "p99": None, "n": 0}
    if len(times) == 1:
        return {"p50": times[0], "p99": times[0], "n": 1}
    hundredths = statistics.quantiles(times, n=100, method="inclusive")
    return {"p50": hundredths[49], "p99": hundredths[98], "n": len(times)}


def coding(facts: dict[str, Any]) -> dict[str, str]:
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


def captures(facts: dict[str, Any], folder: Path) -> str:
    """Return where packet captures are, and what they miss."""
    if not facts["captures"]:
        return "none"
    missed = facts.get("packets_not_captured", 0)
    return f"{folder}/*.pcap" + (f", {missed:,} packets missed" if missed else "")


def rows_of_every_run(facts: dict[str, Any], folder: Path) -> dict[str, str]:
    """Return what is said of light paths, simulation and files, whatever the run was for."""
    setup = facts["path_setup_ms"]
    return {
        "metadata to light path": "no path was set up"
        if setup["p50"] is None
        else f"p50 {setup['p50']:.2f} ms, p99 {setup['p99']:.2f} ms, n {setup['n']}",
        **software_share.rows(facts),
        "quantum states": f"{facts['backend']}, {EXACTNESS[facts['exact']]}",
        "captures": captures(facts, folder),
        "quantum events": f"{folder}/{EVENT_LOG}" if facts["events"] else "not written",
        "one timeline of both": facts["timeline"],
        "report to look at": facts["report"],
        "all facts": f"{folder}/result.json",
    }


def show(console: Console, facts: dict[str, Any], folder: Path) -> None:
    """Print the table."""
    rate = facts["symbol_error_rate"]
    outcome = "delivered exactly" if facts["delivered"] else "NOT DELIVERED"
    rows = {
        "message": f"{facts['message_bytes']:,} bytes, {outcome}",
        "Bell pairs used": f"{facts['bell_pairs']:,}",
        "pairs lost": f"{facts['lost_pairs']:,}",
        "symbol error rate": "no symbol received" if rate is None else f"{rate:.4g}",
        **coding(facts),
        "repeated frames": f"{facts['repeated_frames']:,}",
        "pairs/s": f"{facts['pairs_per_s']:,.0f} ({facts['elapsed_s']:.2f} s)",
        **rows_of_every_run(facts, folder),
    }
    print_rows(console, rows)


def print_rows(console: Console, rows: dict[str, str]) -> None:
    """Print names and values below each other; no value is cut short, however long a path is."""
    width = max(map(len, rows))
    for name, value in rows.items():
        console.print(f"{name:<{width}}  {value}", soft_wrap=True, markup=False, highlight=False)
