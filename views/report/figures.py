"""The figures of a report with their captions, or why one cannot be drawn."""

from collections.abc import Iterator, Sequence
from html import escape

from qmn.results.timeline import TIMELINE
from views.fiber_use import fiber_use
from views.report import charts, error_counts
from views.report.bloch_diagram import bloch_diagram
from views.report.chain_diagram import MOST_NODES, chain_diagram, chain_of
from views.report.drawing import BAD, variable
from views.report.eavesdropped import Eavesdropped, eavesdropped
from views.report.handshake_diagram import handshake_diagram
from views.report.key_timeline import key_timeline
from views.report.light_paths import LightPath, without_outcome
from views.report.load_diagram import MOST_FIBERS, load_diagram
from views.report.map_diagram import map_diagram
from views.report.markup import figure, missing, table
from views.report.network_diagram import network_diagram, path_colour
from views.report.run_facts import RunFacts
from views.report.sequence import handshake, lanes
from views.report.waits_diagram import MOST_HOSTS, waits_diagram
from wire.metadata.vocabulary import SYMBOLS
from wire.results.figures import KeyFigures, KeyProgress, PairFigures, SentFigures, TeleportFigures
from wire.results.run_result import KeysJob, LoadJob, ServiceJob
from wire.results.time_series import KeyMoment

MOST_NAMED = 12  # light paths, also in the figure of their losses
MOST_WAITS = 10  # in a table
FEW_LINES = 3  # of a session whose light came at once
NOT_WRITTEN = "what happened to qubits was not written (--without events)."
METADATA = (
    '<span class="metadata">quantum metadata</span> as it leaves one host and reaches another'
)
OPENFLOW = '<span class="openflow">OpenFlow</span>'
QUANTUM = '<span class="quantum">quantum events</span>'


def network(run: RunFacts, paths: Sequence[LightPath]) -> str:
    text = "Fibres with length and loss, all in the table below"
    text += ". " if run.network.positions else "; dashed: copper. "
    draw = map_diagram if run.network.positions else network_diagram
    eve = eavesdropped(run.network, run.events)
    drawn = draw(run.network, paths, eve)
    return figure("The network", drawn, text + _legend(run, paths) + _measured(eve), "wide")


def _measured(eve: Eavesdropped) -> str:
    if not eve.fibers:
        return ""
    shares = (f"{name}: {share} of the photons" for name, share in eve.fibers.items() if share)
    text = f' <b style="color: {variable(BAD)}">Dashed red: fibres that an eavesdropper measures'
    return f"{text}</b>{escape('; '.join(['', *shares]))}."


def _legend(run: RunFacts, paths: Sequence[LightPath]) -> str:
    if not run.result.events:
        return f"Light paths are not shown: {NOT_WRITTEN}"
    if not paths:
        return "No light path stood."
    if len(paths) > MOST_NAMED:
        return f"{len(paths)} different light paths stood."
    named = (
        f'<b style="color: {variable(path_colour(number))}">{escape(path.begin)} → '
        f"{escape(path.end)}</b>"
        for number, path in enumerate(paths)
    )
    return f"Light paths: {', '.join(named)}."


def load_figure(run: RunFacts, job: LoadJob) -> str:
    title = "Sessions over time, and the use of every fibre"
    load = job.load
    if load is None or not load.sessions:
        return missing(title, "no session was asked for.")
    use = fiber_use(run.network, run.events)
    drawn = load_diagram(load, use, run.result.time_scale or 1.0)
    idle = sum(not intervals for intervals in use.values())
    text = f"Each row is a fibre in one direction; {idle} were never in use. "
    if not run.result.events:
        text = f"The use of fibres is not shown: {NOT_WRITTEN} "
    elif len(use) - idle > MOST_FIBERS:
        text += f"The {MOST_FIBERS} that were in use longest are shown. "
    reasons = {**load.blocked, **load.broken}
    broken = ", ".join(f"{count} {escape(reason)}" for reason, count in reasons.items())
    return figure(title, drawn, text + (f"Refused or broken: {broken}." if broken else ""), "wide")


def waits_figure(job: LoadJob) -> str:
    """Return the picture of who waited for whose light, and the longest waits; "" of none."""
    waits = job.load.waits if job.load is not None else []
    if not waits:
        return ""
    rows = [
        [
            f"{wait.opener} → {wait.acceptor}",
            f"{wait.waited_s:.3g} s",
            f"{wait.ready_s:.3g} s",
            f"{wait.after_opener} → {wait.after_acceptor}",
        ]
        for wait in waits[:MOST_WAITS]
    ]
    heads = ["waited", "duration", "until", "for the light of"]
    text = "Seconds that sessions of the host on the left waited until one of the host below gave "
    text += "back the last of their light. Sessions that were refused after a wait are left out. "
    openers = {name for wait in waits for name in (wait.opener, wait.after_opener)}
    if len(openers) > MOST_HOSTS:
        text += f"The {MOST_HOSTS} hosts with the longest waits are shown. "
    if len(waits) > MOST_WAITS:
        text += f"The table has the {MOST_WAITS} longest of {len(waits)} waits."
    return figure(
        "Who waited for whom", f"{waits_diagram(waits)}{table(heads, rows)}", text, "wide"
    )


def handshake_figure(run: RunFacts) -> str:
    port = run.result.settings.openflow_port
    steps, more = handshake(run.folder, run.network, run.events, port)
    title = "The handshake, in both layers"
    if not steps:
        packets = "no set-up was captured" if run.result.captures else "packets were not captured"
        qubits = "nothing happened to a qubit." if run.result.events else NOT_WRITTEN
        return missing(title, f"{packets}, and {qubits}")
    if not any(step.layer == "metadata" for step in steps):
        title = "The handshake, in the quantum layer"
        text = "Packets were not captured: quantum events alone, from the first on."
    else:
        layers = f"{METADATA}, {OPENFLOW}"
        text = f"On one clock: {layers}, {QUANTUM}." if run.result.events else f"{layers}."
        text += " Times count from the first set-up."
        if not run.result.events:
            title = "The handshake, in the classical layer"
            text += f" Quantum events are missing: {NOT_WRITTEN}"
    if more:
        file = TIMELINE if (run.folder / TIMELINE).exists() else "the captures"
        text += f" The rest is in {file}."
    return figure(
        title, handshake_diagram(steps, lanes(steps, run.network)), text, "wide handshake"
    )


def key_figure(job: KeysJob) -> str:
    time_series = job.time_series
    if not time_series:
        return missing("Keys over time", "nothing has happened to any.")
    text = "Sessions by their error rate, above the dashed line without a key; shaded: eve listens."
    if any(isinstance(moment, KeyMoment) for moment in time_series):
        text += " Bars: the tunnel is open at this host; strokes: a new key."
    return figure("Keys over time", key_timeline(time_series), text, "wide")


def key_distribution_figures(run: RunFacts) -> Iterator[str]:
    """Yield what a session of key distribution found; nothing for other runs."""
    keys = run.result.asking
    if not isinstance(keys, KeyFigures):
        return
    lines = [each for each in run.sender if isinstance(each, KeyProgress)]
    rates = _error_rates(lines) or _error_rates([keys])
    if keys.max_qber is not None and rates:
        drawn = charts.error_rate(rates, keys.max_qber)
        text = "Of the disclosed bits of each key, with its interval of 95 %. An eavesdropper who "
        text += "measures and resends all photons causes 25 %."
        yield figure("Error rate", drawn, text)
    if len(lines) > FEW_LINES:
        counts = {
            "sifted bits": [line.sifted_bits for line in lines],
            "secret key bits": [line.key_bits for line in lines],
        }
        drawn = charts.key_growth([line.elapsed_s for line in lines], counts)
        yield figure("Growth of the key", drawn, "As each key was made of its blocks of light.")
    if keys.photons:
        steps = {
            "photons": keys.photons,
            "detected": keys.raw_bits,
            "sifted": keys.sifted_bits,
            "secret key": keys.key_bits,
        }
        text = "Sifting keeps bits measured in the same basis; error correction and privacy "
        text += "amplification shorten them."
        yield figure("From photons to key", charts.key_steps(steps), text)


def _error_rates(lines: Sequence[KeyProgress]) -> list[charts.Rate]:
    """Return time and error rate of each key; the first line without keys of its own: of all."""
    rates: list[charts.Rate] = []
    for line in lines:
        rate: Sequence[float | None] = line.newest_qber or ()
        if not rate and not rates:
            rate = line.qber, line.qber_low, line.qber_high
        match rate:
            case [float(value), float(low), float(high)]:
                if not rates or (value, low, high) != rates[-1][1:]:
                    rates.append((line.elapsed_s, value, low, high))
    return rates


def pictures_of_states(run: RunFacts) -> Iterator[str]:
    """Yield the picture of teleported or received states, or of the chain of a swapped pair."""
    if run.result.message is not None:
        sent = run.result.asking
        bell_states = sent.symbols if isinstance(sent, SentFigures) else 0
        yield _confusion(run, bell_states if bell_states in SYMBOLS else max(SYMBOLS))
    job = run.result.job
    report = job.asked if isinstance(job, ServiceJob) else None
    if isinstance(report, TeleportFigures) and report.of_states:
        text = "Dotted: the six states as sent. Arrows: as they arrived, with 95 % intervals: of "
        text += "fidelity F the part 2F - 1 is left along the direction in which it was measured."
        drawn = bloch_diagram(report.of_states)
        yield figure("States before and after, in the Bloch sphere", drawn, text)
    if isinstance(report, PairFigures):
        nodes, ages = chain_of(run.events, run.result.hosts[0])
        if 2 < len(nodes) <= MOST_NODES:
            text = "How long the oldest qubit that was used at each node had waited in its memory."
            yield figure("The chain, and the ages of its qubits", chain_diagram(nodes, ages), text)


def chart_figures(run: RunFacts, paths: Sequence[LightPath]) -> Iterator[str]:
    """Yield the charts; those of errors for superdense coding alone."""
    if run.result.message is not None:
        yield _rate(run)
        yield _errors(run)
    if not paths or any(path.loss_db for path in paths):
        yield _losses(run, paths)
    if len(set(run.setup_ms)) != 1:
        yield _setup_times(run)


def _rate(run: RunFacts) -> str:
    title = "Bell pairs a second"
    measured = [event for event in run.events if event.kind == "bell-measure"]
    if not measured:
        return missing(title, "no Bell pair was measured." if run.result.events else NOT_WRITTEN)
    measured.sort(key=lambda event: event.time_ns)
    lists = [(event.time_ns, event.photons, without_outcome(event)) for event in measured]
    times, pairs, lost = map(list, zip(*lists, strict=True))
    begin_ns = min([*times, *(e.time_ns for e in run.events if e.kind == "create")])
    text = f"Blocks counted when the receiver measured them: {len(measured):,}."
    return figure(title, charts.rate(begin_ns, times, pairs, lost), text)


def _errors(run: RunFacts) -> str:
    title = "Errors over time"
    sender = run.result.hosts[0]
    errors = error_counts.reported(run.folder, run.network, sender) or error_counts.printed(
        [each for each in run.sender if isinstance(each, SentFigures)],
        run.result.time_scale or 1.0,
    )
    if errors is None:
        return missing(title, "the sender reported nothing.")
    if not any(values[-1] for values in errors.counts.values()):
        return ""  # the sentence of the run says so
    text = f"{errors.whence}; in the end: {errors.last}."
    return figure(title, charts.errors(errors.seconds, errors.counts), text)


def _confusion(run: RunFacts, bell_states: int) -> str:
    title, counts = "Bell states sent and received", run.confusion
    if counts is None:
        return missing(
            title, "the receiver reports it at the end, which the transfer did not reach."
        )
    if not counts.any():
        return missing(title, "no frame was delivered whole.")
    text = "Of the frames delivered in the end, with their rejected versions: before a frame's "
    text += "check is right, the receiver does not know what was sent. Lost pairs are not counted."
    return figure(title, charts.confusion(counts, bell_states), text)


def _losses(run: RunFacts, paths: Sequence[LightPath]) -> str:
    title = "Loss of each hop"
    if not paths:
        return missing(title, "no light path stood." if run.result.events else NOT_WRITTEN)
    budget = run.result.settings.loss_budget_db
    text = "Every light path that stood, as declared: fibres and ways through switches."
    shown = sorted(paths, key=lambda path: path.loss_db, reverse=True)[:MOST_NAMED]
    if len(shown) == len(paths):
        return figure(title, charts.loss_budget(paths, budget), text)
    text = (
        f"Of {len(paths):,} light paths that stood the {MOST_NAMED} that lose most, as declared: "
    )
    text += "fibres and ways through switches."
    return figure(title, charts.loss_budget(shown, budget), text)


def _setup_times(run: RunFacts) -> str:
    title = "Set-up of light paths"
    if not run.setup_ms:
        return missing(title, "no light path was set up.")
    text = f"From metadata at the controller to light path; paths: {len(run.setup_ms):,}."
    return figure(title, charts.setup_times(run.setup_ms), text)
