"""The report as one page: HTML, CSS and SVG, no script, nothing from elsewhere."""

import json
from collections.abc import Iterator
from dataclasses import asdict, is_dataclass
from html import escape
from pathlib import Path
from typing import Any

from qmn.printable_text import printable
from qmn.results.result import size_text
from qmn.results.run_folder import REPORT
from qmn.results.run_result import RunResult
from qmn.results.sentences import of_eve, sentence
from qmn.results.service_result import label, number_rows
from qmn.results.titles import TITLES
from views.report import figures
from views.report.first_photons import first_photons
from views.report.light_paths import fiber_name, light_paths, photons_by_port
from views.report.markup import STYLE, table
from views.report.programs import instruction_table, outputs
from views.report.run_facts import RunFacts, read_run
from wire.device import OF_LIGHT, setting_name
from wire.results.figures import Figures, LoadFigures, SentFigures
from wire.results.run_result import KeysJob, LoadJob, NetqasmJob

# Figures that the page begins with; the table below them has all.
MAIN = frozenset(
    {
        *("accepted", "alarm", "blocked", "carried_erlang", "error_rate", "fidelity"),
        *("fidelity_at_least", "file_intact", "key_bits", "key_bits_per_s", "keys", "keys_per_s"),
        *("keys_used", "mean_rad", "pairs", "pairs_per_s", "photons", "qber", "qber_highest"),
        *("qber_x", "score", "sessions", "setup_p50_s", "sifted_bits", "states", "states_per_s"),
        *("sum_error_rad", "sum_rad", "visibility", "waited_ms"),
    }
)
MOST_NAMED = 8  # hosts in a title
LAST_COUNTS = "Counts are the sender's; figures may include later events."
# Of a page that has no script: a run may be another person's.
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
POLICY += "form-action 'none'"


def write_report(folder: Path) -> Path:
    """Write report.html into the folder of a finished run; return the file.

    Raise BadRun for a folder without a run, MalformedPacket for files that are not captures.
    """
    text = printable(page(read_run(folder)))
    unfinished = folder / f".{REPORT}"
    unfinished.unlink(missing_ok=True)  # it may be a link
    unfinished.write_text(text)
    return unfinished.replace(folder / REPORT)


def page(run: RunFacts) -> str:
    name, result = escape(run.folder.name), run.result
    many = len(result.hosts) > MOST_NAMED
    hosts = f"{len(result.hosts)} hosts" if many else ", ".join(result.hosts)
    job = "load" if isinstance(result.asking, LoadFigures) else result.service
    title = escape(f"{TITLES.get(job, job)}: {hosts}")
    return "\n".join(
        [
            '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta name="color-scheme" content="light dark"><link rel="icon" href="data:,">',
            f"<title>{title} · qmn</title><style>{STYLE.read_text()}</style></head><body>",
            f"<header><h1>{title}</h1><p>{name}, seed {result.seed}</p>{_outcome(run)}</header>",
            "<main>",
            *_sections(run),
            "</main></body></html>\n",
        ]
    )


def _outcome(run: RunFacts) -> str:
    result, done = run.result, run.result.delivered
    verdict, numbers = sentence(result), _numbers(result.asking)
    if result.message is not None:
        numbers["bytes of message"] = f"{result.message.bytes:,}"
    kind = "good" if done else "failed"
    tiles = "".join(
        f"<div><b>{escape(value)}</b><span>{escape(name)}</span></div>"
        for name, value in numbers.items()
    )
    reason = result.error if result.error and result.error not in verdict else ""
    error = "".join(f"<p>{escape(text)}</p>" for text in (reason, of_eve(result)) if text)
    note = "" if done else f"<p>{LAST_COUNTS}</p>"
    below = f'<div class="tiles">{tiles}</div>{_every_figure(result.asking)}{note}'
    return f'<p class="{kind}">{escape(verdict)}</p>{error}{below}'


def _every_figure(figures: Figures) -> str:
    rows = [[label(name), _cell(value)] for name, value in vars(figures).items()]
    made = table(["figure", "value"], rows, "parameters")
    return f"<details><summary>All figures</summary>{made}</details>" if rows else ""


def _numbers(figures: Figures) -> dict[str, str]:
    if isinstance(figures, SentFigures):
        rate = figures.symbol_error_rate
        return {
            "Bell pairs": f"{figures.bell_pairs:,}",
            "Bell pairs/s": f"{figures.pairs_per_s:,.0f}",
            "lost pairs": f"{figures.lost_pairs:,}",
            "symbol error rate": "–" if rate is None else f"{rate:.3g}",  # noqa: RUF001
        }
    return number_rows(figures, MAIN)


def _sections(run: RunFacts) -> Iterator[str]:
    paths = light_paths(run.network, run.events)
    keys = [*figures.key_distribution_figures(run)]
    if keys:
        yield '<div class="charts">' + "".join(keys) + "</div>"
        yield first_photons(run.events, (run.result.hosts[0], run.result.hosts[-1]))
    yield from figures.pictures_of_states(run)
    if isinstance(run.result.job, NetqasmJob):
        yield outputs(run.result.job)
        yield instruction_table(run.events, run.result.job.roles)
    yield figures.network(run, paths)
    if isinstance(run.result.job, LoadJob):
        yield figures.load_figure(run, run.result.job)
        yield figures.waits_figure(run.result.job)
    if isinstance(run.result.job, KeysJob):
        yield figures.key_figure(run.result.job)
    yield figures.handshake_figure(run)
    yield '<div class="charts">'
    yield from figures.chart_figures(run, paths)
    yield "</div>"
    yield _fibers(run)
    yield _parameters(run.result)


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
    number = "1 fibre" if len(rows) == 1 else f"{len(rows):,} fibres"
    section = f"<details><summary>{number}</summary>{table(heads, rows)}{note}</details>"
    return f"<section><h2>Fibres</h2>{section}</section>"


def _parameters(result: RunResult) -> str:
    names = ("seed", "service", "topology", "controller", "backend", "exact", "mode")
    of_time = (
        "time",
        "time_scale",
        "time_because",
        "acausal",
    )
    rows = [[name, _cell(getattr(result, name))] for name in (*names, *of_time)]
    met = result.approximations
    rows += [[f"approximated: {each.name}", size_text(each)] for each in met]
    rows += [[name, _cell(value)] for name, value in result.recorded_parameters.items()]
    if isinstance(result.asking, SentFigures):
        used = {name: getattr(result.asking, name) for name in OF_LIGHT}
        rows += [[f"in use: {name}", _cell(setting_name(name, used[name]))] for name in used]
    optics = vars(result.every_fiber) if result.every_fiber else {}
    rows += [[f"fibre: {name}", _cell(value)] for name, value in optics.items()]
    devices = {host: device.to_dict() for host, device in result.devices.items()}
    rows += [[f"device: {host}", _cell(parts)] for host, parts in devices.items() if parts]
    made = table(["parameter", "value"], rows, "parameters")
    return f"<details><summary>Parameters and seed</summary>{made}</details>"


def _cell(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(_cell, value)) or "–"  # noqa: RUF001
    if isinstance(value, dict):
        return ", ".join(f"{name}: {_cell(each)}" for name, each in value.items())
    if is_dataclass(value) and not isinstance(value, type):
        return _cell(asdict(value))
    if value is None or value == "":
        return "–"  # noqa: RUF001
    return value if isinstance(value, str) else json.dumps(value)
