"""The facts of a run: result.json for programs, a short table for people."""

import json
import statistics
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from qmn.results import message_result, service_result, software_share
from qmn.results.message_result import RECEIVED as RECEIVED
from qmn.results.schema import Approximated, NetworkResult, RunFacts, SetUpTimes, WatchedLight
from topologies.networks.network import Network
from topologies.system.runs.runtime import EVENT_LOG, RECORD
from wire.controller_lines import read_record
from wire.dispatcher_record import has_ended
from wire.metadata import Reason

EXACTNESS = {True: "exact", False: "with approximations", None: "exactness unknown"}


def complete(facts: RunFacts, folder: Path) -> None:
    """Add what the run has left in its folder, and write result.json."""
    (message_result if carries_bytes(facts) else service_result).complete(facts, folder)
    facts["emulation"] = emulation(facts.get("asking", dict(facts)), facts)
    note_controller(facts, read_record(folder))
    (folder / "result.json").write_text(json.dumps(facts, indent=2) + "\n")


def carries_bytes(facts: Mapping[str, Any]) -> bool:
    """Return whether the run was to bring a file from one host to the other."""
    return "file" in facts


def emulation(told: dict[str, Any], facts: RunFacts) -> dict[str, float]:
    """Return how long it took here, and rates by the wall: the speed of the emulation."""
    scale = facts.get("time_scale", 1.0)  # a run that did not start has none
    rates = {name: rate / scale for name, rate in told.items() if name.endswith("_per_s") and rate}
    return {"elapsed_s": told.get("elapsed_s", 0.0) * scale, **rates}


def note_controller(facts: RunFacts, lines: list[dict[str, Any]]) -> None:
    """Add path set-up times (ms), packet-ins and seals from the controller's record."""
    times = [line["setup_ms"] for line in lines if line["event"] == "path_ready"]
    counts = [line["packet_in_count"] for line in lines if "packet_in_count" in line]
    facts["path_setup_ms"], facts["packet_in_count"] = percentiles(times), max(counts, default=0)
    if any(line["event"] in ("watched", "alarm") for line in lines):
        facts["watched"] = _watched(lines)


def _watched(lines: list[dict[str, Any]]) -> WatchedLight:
    """Return what seals have found."""
    over = [line for line in lines if line["event"] == "watched"]
    alarms = [line for line in lines if line["event"] == "alarm"]
    return {
        "seals": len(over),
        "given_back": sum(line["end"] == Reason.BUSY.name for line in over),
        "compared": sum(line["compared"] for line in over),
        "errors": sum(line["errors"] for line in over),
        "alarms": len(alarms),
        "closed": sorted({way for line in alarms if line["closed"] for way in line["watched"]}),
    }


def watched_light(facts: RunFacts) -> dict[str, str]:
    """Return what is said of seals, if there were any."""
    if "watched" not in facts:
        return {}
    seen = facts["watched"]
    closed = f", closed: {' '.join(seen['closed'])}" if seen["closed"] else ""
    pairs = f"{seen['compared']:,} pairs, {seen['errors']:,} of them wrong"
    return {"seals": f"{seen['seals']} over {pairs}, alarms: {seen['alarms']}{closed}"}


def percentiles(times: list[float]) -> SetUpTimes:
    """Return p50, p99 and n; None where there is nothing to tell."""
    if not times:
        return {"p50": None, "p99": None, "n": 0}
    if len(times) == 1:
        return {"p50": times[0], "p99": times[0], "n": 1}
    hundredths = statistics.quantiles(times, n=100, method="inclusive")
    return {"p50": hundredths[49], "p99": hundredths[98], "n": len(times)}


def note_files(facts: NetworkResult, network: Network) -> None:
    """Add what captures lack, and which files have ended before the network did."""
    facts["packets_not_captured"] = network.captures.packets_missed
    record = network.runtime.logs / RECORD
    facts["files_ended"] = [*network.captures.full, *([RECORD] if has_ended(record) else [])]


def captures(facts: RunFacts, folder: Path) -> str:
    """Return where packet captures are, and what they miss."""
    if not facts["captures"]:
        return "none"
    missed = facts.get("packets_not_captured", 0)
    return f"{folder}/*.pcap" + (f", {missed:,} packets missed" if missed else "")


def files_ended(facts: RunFacts) -> dict[str, str]:
    """Return what is said of files that have become too long, if there are any."""
    if not facts.get("files_ended"):
        return {}
    names = ", ".join(facts["files_ended"])
    return {"not whole": f"{names}: what came after --file-gib is in none, nor in the timeline"}


def approximations(facts: RunFacts) -> dict[str, str]:
    """Return why a result is not exact, and by how much, if it is not."""
    told = [f"{each['name']}: {said_size(each)}" for each in facts.get("approximations", ())]
    return {"approximated": "; ".join(told)} if told else {}


def said_size(each: Approximated) -> str:
    """Return how large an approximation is, in words."""
    if each["most"] is None:
        return "size not known"
    return f"a probability is wrong by {each['most']:.2g} at most"


def rows_of_every_run(facts: RunFacts, folder: Path) -> dict[str, str]:
    """Return what is said of light paths, simulation and files, whatever the run was for."""
    setup = facts["path_setup_ms"]
    return {
        "metadata to light path": "no path was set up"
        if setup["p50"] is None
        else f"p50 {setup['p50']:.2f} ms, p99 {setup['p99']:.2f} ms, n {setup['n']}",
        **watched_light(facts),
        **software_share.rows(facts),
        "quantum states": f"{facts['backend']}, {EXACTNESS[facts['exact']]}",
        **approximations(facts),
        "captures": captures(facts, folder),
        **files_ended(facts),
        "quantum events": f"{folder}/{EVENT_LOG}" if facts["events"] else "not written",
        "one timeline of both": facts["timeline"],
        "report to look at": facts["report"],
        "all facts": f"{folder}/result.json",
    }


def show(console: Console, facts: RunFacts, folder: Path) -> None:
    """Print the table."""
    own = (message_result if carries_bytes(facts) else service_result).rows(facts)
    print_rows(console, {**own, **rows_of_every_run(facts, folder)})


def print_rows(console: Console, rows: dict[str, str]) -> None:
    """Print names and values below each other; no value is cut short, however long a path is."""
    width = max(map(len, rows))
    for name, value in rows.items():
        console.print(f"{name:<{width}}  {value}", soft_wrap=True, markup=False, highlight=False)
