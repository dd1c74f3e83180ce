"""The result of a run: result.json for programs, a short table for people."""

import statistics
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from qmn.network.time_scale import PACED
from qmn.printable_text import printable
from qmn.results import pace_row, service_result
from qmn.results.run_result import NetworkResult, RunResult
from qmn.results.sentences import of_eve, sentence
from qmn.results.service_result import RECEIVED as RECEIVED
from topologies.links.fiber import FiberLink
from topologies.networks.network import Network
from topologies.system.runs.runtime import EVENT_LOG, RECORD
from wire.controller_lines import read_record
from wire.dispatcher_record import has_ended
from wire.metadata.vocabulary import Reason
from wire.results.run_result import (
    Approximated,
    NetworkFacts,
    ServiceJob,
    Sessions,
    SetUpTimes,
    SwitchCopies,
    WatchedLight,
)

EXACTNESS = {True: "exact", False: "with approximations", None: "exactness unknown"}
MOST_IDS = 100  # of sessions


def complete(facts: RunResult, folder: Path) -> None:
    note_outcome(facts, folder, read_record(folder))
    facts.write(folder)


def note_outcome(facts: RunResult, folder: Path, record: list[dict[str, Any]]) -> None:
    """Add what a job has come to: by its figures, the bytes in its folder, and the controller."""
    if isinstance(facts.job, ServiceJob) and facts.job.message is not None:
        facts.job.message = service_result.message(facts.job.message.file, folder)
        facts.delivered = facts.job.message.arrived
    figures = vars(facts.asking)
    facts.elapsed_s = figures.get("elapsed_s", facts.elapsed_s)
    if facts.time == PACED:
        facts.emulation = emulation(figures, facts.elapsed_s, facts.time_scale)
    note_controller(facts, record)


def emulation(
    figures: Mapping[str, Any], elapsed_s: float | None, time_scale: float | None
) -> dict[str, float]:
    """Return the speed of the emulation: how long it took here, if known, and rates by the wall."""
    scale = time_scale or 1.0  # a run that did not start has none
    rates = {
        name: rate / scale for name, rate in figures.items() if name.endswith("_per_s") and rate
    }
    return rates if elapsed_s is None else {"elapsed_s": elapsed_s * scale, **rates}


def note_controller(facts: RunResult, lines: list[dict[str, Any]]) -> None:
    """Add sessions, set-up times (ms), packet-ins and monitors from the controller's record."""
    times = [line["setup_ms"] for line in lines if line["event"] == "path_ready"]
    counts = [line["packet_in_count"] for line in lines if "packet_in_count" in line]
    facts.sessions, facts.copies = sessions(lines), copies(lines)
    facts.path_setup_ms, facts.packet_in_count = percentiles(times), max(counts, default=0)
    if any(line["event"] in ("watched", "alarm") for line in lines):
        facts.watched = _watched(lines)


def sessions(lines: list[dict[str, Any]]) -> Sessions:
    """Return which sessions were granted, and how many were refused; each is counted once."""
    granted, refused = (
        list(dict.fromkeys(line["session"] for line in lines if line["event"] == event))
        for event in ("granted", "refused")
    )
    return Sessions(len(granted), len(refused), granted[:MOST_IDS])


def copies(lines: list[dict[str, Any]]) -> SwitchCopies | None:
    """Return which switches had the set-ups of sessions when these got light; None: none has.

    A copy at the instant of its set-up, which stepped time may order behind the grant, is in time.
    """
    granted = [line["copies_ms"] for line in lines if "copies_ms" in line]
    if not granted:
        return None
    each_ms = [after_ms for switches in granted for after_ms in switches.values()]
    at_grant = [after_ms for after_ms in each_ms if after_ms is not None]
    behind = [line["setup_ms"] for line in lines if line["event"] == "copy_late"]
    late = sum(after_ms > 0 for after_ms in behind)
    missing = max(len(each_ms) - len(at_grant) - len(behind), 0)
    came = [*at_grant, *behind]
    return SwitchCopies(len(came) - late, late, missing, percentiles(came).p50)


def _watched(lines: list[dict[str, Any]]) -> WatchedLight:
    over = [line for line in lines if line["event"] == "watched"]
    alarms = [line for line in lines if line["event"] == "alarm"]
    return WatchedLight(
        monitors=len(over),
        preempted=sum(line["end"] == Reason.BUSY.name for line in over),
        compared=sum(line["compared"] for line in over),
        errors=sum(line["errors"] for line in over),
        alarms=len(alarms),
        closed=sorted({way for line in alarms if line["closed"] for way in line["watched"]}),
    )


def watched_light(seen: WatchedLight | None) -> dict[str, str]:
    if seen is None:
        return {}
    closed = f", closed: {' '.join(seen.closed)}" if seen.closed else ""
    pairs = f"{seen.compared:,} pairs, {seen.errors:,} of them wrong"
    return {"link monitors": f"{seen.monitors} over {pairs}, alarms: {seen.alarms}{closed}"}


def percentiles(times: list[float]) -> SetUpTimes:
    """Return p50, p99 and n; None where there is nothing to tell."""
    if not times:
        return SetUpTimes()
    if len(times) == 1:
        return SetUpTimes(times[0], times[0], 1)
    hundredths = statistics.quantiles(times, n=100, method="inclusive")
    return SetUpTimes(hundredths[49], hundredths[98], len(times))


def network_facts(network: Network) -> NetworkFacts:
    runtime = network.runtime
    copper = [
        [link.intf1.node.name, link.intf1.name, link.intf2.node.name, link.intf2.name]
        for link in network.net.links
        if not isinstance(link, FiberLink)
    ]
    copper_ids = {name: int(network.net[name].dpid, 16) for name in network.copper_switches}
    return NetworkFacts(
        {host: address.partition("/")[0] for host, address in runtime.addresses.items()},
        runtime.source,
        list(runtime.fibers),
        list(runtime.switches.values()),
        copper,
        {name: (x, y) for name, (x, y) in getattr(network.net.topo, "positions", {}).items()},
        runtime.datapath_ids | copper_ids,
        network.copper_switches,
    )


def note_files(facts: NetworkResult, network: Network) -> None:
    """Add what captures lack, and which files have ended before the network did."""
    facts.packets_not_captured = network.captures.packets_missed
    record = network.runtime.logs / RECORD
    facts.files_ended = [*network.captures.full, *([RECORD] if has_ended(record) else [])]


def captures(facts: RunResult, folder: Path) -> str:
    if not facts.captures:
        return "none"
    missed = facts.packets_not_captured
    return f"{folder}/*.pcap" + (f", {missed:,} packets missed" if missed else "")


def files_ended(facts: RunResult) -> dict[str, str]:
    """Return the row of files that have become too long, if there are any."""
    if not facts.files_ended:
        return {}
    names = ", ".join(facts.files_ended)
    return {"not whole": f"{names}: what came after --file-gib is in none, nor in the timeline"}


def lost_waiting(facts: RunResult) -> dict[str, str]:
    """Return what was lost in delay lines, which have a loss though fibres may have none."""
    if not facts.photons_lost_waiting:
        return {}
    photons = f"{facts.photons_lost_waiting:,} photons, which waited for halves of longer ways"
    return {"lost in delay lines": f"{photons} (--device HOST.analyser.delay_line_db_per_km)"}


def approximations(facts: RunResult) -> dict[str, str]:
    """Return why a result is not exact, and by how much, if it is not."""
    texts = [f"{each.name}: {size_text(each)}" for each in facts.approximations]
    return {"approximated": "; ".join(texts)} if texts else {}


def weak_pulses(facts: RunResult) -> dict[str, str]:
    """Return why pulses were simulated one by one that could have been left out, if any were."""
    if not facts.drawn_for:
        return {}
    return {"weak pulses": f"simulated one by one, for {', '.join(facts.drawn_for)}"}


def size_text(each: Approximated) -> str:
    return f"a probability is wrong by {each.most:.2g} at most"


def rows_of_every_run(facts: RunResult, folder: Path, report: str) -> dict[str, str]:
    """Return rows about light paths, simulation and files, for every kind of run.

    `report` is its file, or how to make it.
    """
    setup = facts.path_setup_ms
    return {
        "path set-up time": "no path was set up" if setup.p50 is None else str(setup),
        **({} if facts.copies is None else {"set-ups at switches": str(facts.copies)}),
        **watched_light(facts.watched),
        **lost_waiting(facts),
        **pace_row.rows(facts),
        "quantum states": f"{facts.backend}, {EXACTNESS[facts.exact]}",
        **approximations(facts),
        **weak_pulses(facts),
        "captures": captures(facts, folder),
        **files_ended(facts),
        "quantum events": f"{folder}/{EVENT_LOG}" if facts.events else "not written",
        "one timeline of both": facts.timeline,
        "report to look at": report,
        "all facts": f"{folder}/result.json",
    }


def show(console: Console, facts: RunResult, folder: Path, report: str) -> None:
    common = rows_of_every_run(facts, folder, report)
    print_rows(console, {**_sentences(facts), **service_result.rows(facts.job), **common})


def _sentences(facts: RunResult) -> dict[str, str]:
    """Return the result in words, and what an eavesdropper did."""
    texts = {} if facts.message is not None else {"result": sentence(facts)}
    return texts | ({"eve": eve} if (eve := of_eve(facts)) else {})


def print_rows(console: Console, rows: dict[str, str]) -> None:
    """Print names and values below each other; no value is cut short, however long a path is."""
    width = max(map(len, rows))
    for name, value in rows.items():
        line = printable(f"{name:<{width}}  {value}")
        console.print(line, soft_wrap=True, markup=False, highlight=False)
