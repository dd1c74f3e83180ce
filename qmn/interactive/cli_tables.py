"""The tables and lines of the quantum verbs of `qmn cli`."""

import statistics
from collections.abc import Sequence

from rich.table import Table

from qmn.running.tables import counted, host_table, number_text, table
from qmn.scripting.exchange import Exchange
from qmn.scripting.light import FiberState, Hop, LightPath
from qmn.scripting.network import HostState


def sent(receiver: str, used: Exchange) -> str:
    text = used.data.decode(errors="backslashreplace")
    return f"{receiver}: {text}\n{counted(used.size, 'byte')}, {_cost(used)}"


def ping_line(number: int, receiver: str, used: Exchange) -> str:
    return f"{receiver}: round={number} {_cost(used)}"


def _cost(used: Exchange) -> str:
    return (
        f"{used.bell_pairs:,} pairs, {used.lost_pairs:,} lost, {used.symbol_errors:,} wrong; "
        f"set-up {used.setup_s * 1e3:.2f} ms, then {used.elapsed_s * 1e3:.2f} ms"
    )


def ping_summary(receiver: str, rounds: Sequence[Exchange], tried: int) -> str:
    pairs = sum(each.bell_pairs for each in rounds)
    arrived = pairs - sum(each.lost_pairs for each in rounds)
    symbols = sum(each.received_symbols for each in rounds)
    errors = sum(each.symbol_errors for each in rounds)
    lines = [
        f"--- {receiver} qping statistics ---",
        f"{counted(tried, 'round')}, {len(rounds)} delivered; {pairs:,} pairs, "
        f"{arrived:,} arrived, {_percent(pairs - arrived, pairs)} lost, "
        f"{_percent(errors, symbols)} wrong",
    ]
    if rounds:
        times = [each.setup_s * 1e3 for each in rounds]
        spread = statistics.pstdev(times)
        lines.append(
            f"set-up min/avg/max/mdev = {min(times):.3f}/{statistics.fmean(times):.3f}/"
            f"{max(times):.3f}/{spread:.3f} ms"
        )
    return "\n".join(lines)


def _percent(part: int, whole: int) -> str:
    return f"{100 * part / whole:.3g} %" if whole else "0 %"


def rate(sender: str, receiver: str, used: Exchange) -> str:
    wrong = used.symbol_error_rate
    return (
        f"{sender} to {receiver}: {used.elapsed_s:.2f} s, {used.bell_pairs:,} pairs, "
        f"{used.pairs_per_s:,.0f} pairs/s, {used.bits_per_s:,.0f} bit/s, "
        f"{_percent(used.lost_pairs, used.bell_pairs)} lost, "
        f"{'-' if wrong is None else f'{100 * wrong:.3g} %'} wrong"
    )


def fibers_table(fibers: Sequence[FiberState]) -> Table:
    columns = ("", "", "length", "loss now", "", "photons ->", "<-", "lost in the switch")
    return table("fibres", columns, [_fiber_row(fiber) for fiber in fibers])


def _fiber_row(fiber: FiberState) -> list[str]:
    up = {True: "whole", False: "cut", None: "-"}[fiber.up]
    counts = (fiber.photons_to_b, fiber.photons_to_a, fiber.lost_in_switches)
    length = f"{fiber.length_km:g} km"
    return [fiber.a, fiber.b, length, f"{fiber.loss_db:.3g} dB", up, *map(number_text, counts)]


def trace(path: LightPath) -> Table:
    ends = f"{path.hops[0].begin} to {path.hops[-1].end}"
    title = f"{ends}: {path.loss_db:.3g} dB, rotation {path.rotation.name}"
    rows = [[str(number), *_hop_row(hop)] for number, hop in enumerate(path.hops, 1)]
    return table(title, ("hop", "", "from", "to", "length", "loss", "rotation"), rows)


def _hop_row(hop: Hop) -> list[str]:
    length = f"{hop.length_km:g} km" if hop.what == "fibre" else "-"
    return [hop.what, hop.begin, hop.end, length, f"{hop.loss_db:.3g} dB", hop.rotation.name]


def state(state: HostState) -> list[Table]:
    rows = [
        [held.session, f"{held.number}/{held.half}", f"{held.photons:,}", held.place or "at hand"]
        for held in state.blocks
    ]
    title = "blocks" if rows else "blocks: none"
    columns = ("session", "block", "photons", "where")
    return [host_table(state.device), table(title, columns, rows)]
