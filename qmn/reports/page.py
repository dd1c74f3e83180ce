"""The report as one page: HTML, CSS and SVG, no script, nothing from elsewhere."""

import json
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from qmn.reports import charts
from qmn.reports.drawing import variable
from qmn.reports.handshake_diagram import handshake_diagram
from qmn.reports.light_paths import (
    LightPath,
    fiber_name,
    light_paths,
    photons_by_port,
    without_outcome,
)
from qmn.reports.network_diagram import network_diagram, path_colour
from qmn.reports.run_facts import RunFacts, read_run
from qmn.reports.sequence import handshake, lanes
from topologies.runtime import OPENFLOW_PORT

REPORT = "report.html"
STYLE = Path(__file__).with_name("report.css")
ERRORS = {
    "symbol errors": "symbol_errors",
    "lost pairs": "lost_pairs",
    "repeated frames": "repeated_frames",
}


def write_report(folder: Path) -> Path:
    """Write report.html into the folder of a finished run; return the file.

    Raise BadRun for a folder without a run, MalformedPacket for captures that are none.
    """
    text = page(read_run(folder))
    unfinished = folder / f".{REPORT}"
    unfinished.write_text(text)
    return unfinished.replace(folder / REPORT)


def page(run: RunFacts) -> str:
    """Return the whole page."""
    name = escape(run.folder.name)
    return "\n".join(
        [
            '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta name="color-scheme" content="light dark"><link rel="icon" href="data:,">',
            f"<title>{name} · qmn</title><style>{STYLE.read_text()}</style></head><body>",
            f"<header><h1>{name}</h1>{_outcome(run.result)}</header><main>",
            *_sections(run),
            "</main></body></html>\n",
        ]
    )


def _outcome(result: Mapping[str, Any]) -> str:
    words = "delivered exactly" if result["delivered"] else "NOT DELIVERED"
    kind = "good" if result["delivered"] else "failed"
    rate = result["symbol_error_rate"]
    numbers = {
        "Bell pairs": f"{result['bell_pairs']:,}",
        "Bell pairs/s": f"{result['pairs_per_s']:,.0f}",
        "lost pairs": f"{result['lost_pairs']:,}",
        "symbol error rate": "–" if rate is None else f"{rate:.3g}",  # noqa: RUF001
        "message": f"{result['message_bytes']:,} bytes",
        "seed": f"{result['seed']}",
    }
    tiles = "".join(
        f"<div><b>{value}</b><span>{name}</span></div>" for name, value in numbers.items()
    )
    error = f"<p>{escape(result['error'])}</p>" if result.get("error") else ""
    return f'<p class="{kind}">{words}</p>{error}<div class="tiles">{tiles}</div>'


def _sections(run: RunFacts) -> Iterator[str]:
    paths = light_paths(run.network, run.events)
    yield _figure(
        "The network",
        network_diagram(run.network, paths),
        "Fibres with length and loss, all in the table below; dashed: copper. " + _legend(paths),
        "wide",
    )
    yield _handshake(run)
    yield '<div class="charts">'
    yield from _charts(run, paths)
    yield "</div>"
    yield _fibers(run)
    yield _parameters(run.result)


def _legend(paths: Sequence[LightPath]) -> str:
    if not paths:
        return "No light path stood."
    named = (
        f'<b style="color: {variable(path_colour(number))}">{path.begin} → {path.end}</b>'
        for number, path in enumerate(paths)
    )
    return f"Light paths: {', '.join(named)}."


def _handshake(run: RunFacts) -> str:
    port = run.result["parameters"].get("openflow_port", OPENFLOW_PORT)
    steps, more = handshake(run.folder, run.network, run.events, port)
    if not steps:
        return _missing("The handshake", "nothing was captured, and no quantum event happened.")
    text = (
        'On one clock: <span class="metadata">quantum metadata</span> as it leaves one host and '
        'reaches another, <span class="openflow">OpenFlow</span>, <span class="quantum">quantum '
        "events</span>. Times count from the first set-up."
    )
    if not any(step.layer == "metadata" for step in steps):
        text = "Packets were not captured: quantum events alone, from the first on."
    text += " What followed is in all.pcapng." if more else ""
    drawn = handshake_diagram(steps, lanes(steps, run.network))
    return _figure("The handshake, in both layers", drawn, text, "wide handshake")


def _charts(run: RunFacts, paths: Sequence[LightPath]) -> Iterator[str]:
    measured = [event for event in run.events if event.kind == "bell-measure"]
    measured.sort(key=lambda event: event.time_ns)
    title = "Bell pairs a second"
    if measured:
        lists = [(event.time_ns, event.photons, without_outcome(event)) for event in measured]
        times, pairs, lost = map(list, zip(*lists, strict=True))
        begin_ns = min([*times, *(e.time_ns for e in run.events if e.kind == "create")])
        text = f"Blocks counted when the receiver measured them: {len(measured):,}."
        yield _figure(title, charts.rate(begin_ns, times, pairs, lost), text)
    else:
        yield _missing(title, "no Bell pair was measured.")
    title = "Errors over time"
    if run.sender:
        # A session begins without an error.
        seconds = [0.0, *(line["elapsed_s"] for line in run.sender)]
        counts = {
            label: [0, *(line[name] for line in run.sender)] for label, name in ERRORS.items()
        }
        last = ", ".join(f"{values[-1]:,} {label}" for label, values in counts.items())
        text = f"As the sender has heard of them, chunk by chunk; in the end {last}."
        yield _figure(title, charts.errors(seconds, counts), text)
    else:
        yield _missing(title, "the sender has said nothing.")
    yield _confusion(run)
    title = "Loss of each hop"
    if paths:
        budget = run.result["parameters"]["loss_budget_db"]
        text = "Every light path that stood, as declared: fibres and ways through switches."
        yield _figure(title, charts.loss_budget(paths, budget), text)
    else:
        yield _missing(title, "no light path stood.")
    title = "Set-up of light paths"
    if run.setup_ms:
        text = f"From metadata at the controller to light path; paths: {len(run.setup_ms):,}."
        yield _figure(title, charts.setup_times(run.setup_ms), text)
    else:
        yield _missing(title, "no light path was set up.")


def _confusion(run: RunFacts) -> str:
    title, counts = "Symbols sent and received", run.confusion
    if not counts.any():
        return _missing(title, "no frame was delivered whole.")
    text = "Of the frames delivered in the end, with their rejected versions: before a frame's "
    text += "check is right, the receiver does not know what was sent. Lost pairs are not counted."
    return _figure(title, charts.confusion(counts, run.result.get("bell_states") or 4), text)


def _fibers(run: RunFacts) -> str:
    arrived = photons_by_port(run.events)
    rows = []
    for fiber in run.network.fibers:
        photons, lost = map(
            sum, zip(*(arrived.get(end.port, (0, 0)) for end in (fiber.a, fiber.b)), strict=True)
        )
        rows.append(
            [
                fiber_name(fiber),
                fiber.kind,
                f"{fiber.length_km:g} km",
                f"{fiber.loss_db:.3g} dB",
                f"{fiber.delay_s * 1e6:.3g} µs",
                f"{photons:,}" if photons else "–",  # noqa: RUF001
                f"{lost:,}" if photons else "–",  # noqa: RUF001
            ]
        )
    heads = ["fibre", "kind", "length", "loss", "delay", "photons to its host", "of these lost"]
    note = "<p>Photons count with the blocks they belong to; lost: anywhere before.</p>"
    return f"<section><h2>Fibres</h2>{_table(heads, rows)}{note}</section>"


def _parameters(result: Mapping[str, Any]) -> str:
    names = ("seed", "topology", "handshake", "controller", "backend", "exact", "mode")
    rows = [[name, _said(result.get(name))] for name in names]
    rows += [[name, _said(value)] for name, value in result["parameters"].items()]
    rows += [[f"in use: {name}", _said(value)] for name, value in (result["in_use"] or {}).items()]
    rows += [[f"fibre: {name}", _said(value)] for name, value in result["optics"].items()]
    rows += [
        [f"device: {host}", _said(parts)] for host, parts in result["devices"].items() if parts
    ]
    table = _table(["parameter", "value"], rows, "parameters")
    return f"<section><h2>Parameters and seed</h2>{table}</section>"


def _said(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_said, value)) or "–"  # noqa: RUF001
    if isinstance(value, dict):
        return ", ".join(f"{name}: {_said(each)}" for name, each in value.items())
    return value if isinstance(value, str) else json.dumps(value)


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], kind: str = "") -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in heads)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    table = f'<table class="{kind}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
    return f'<div class="scroll">{table}</div>'


def _figure(title: str, drawn: str, text: str, kind: str = "") -> str:
    """Return a figure; `text` is HTML of ours."""
    caption = f"<figcaption><h2>{title}</h2><p>{text}</p></figcaption>"
    return f'<figure class="{kind}">{caption}<div class="scroll">{drawn}</div></figure>'


def _missing(title: str, why: str) -> str:
    return f"<section><h2>{title}</h2><p>Not drawn: {why}</p></section>"
