"""The charts of a run: its rate, errors, symbols, losses, and how long paths took."""

from collections.abc import Mapping, Sequence
from math import ceil, floor, log10

import numpy as np
from numpy.typing import NDArray

from qmn.reports.axes import (
    SMALL_INCHES,
    Axes,
    Frame,
    Scale,
    Tick,
    framed,
    legend,
    round_values,
    ticks,
)
from qmn.reports.drawing import BAD, INK, METADATA, MUTED, QUANTUM, Drawing
from qmn.reports.light_paths import LightPath

MAX_BINS = 60
MAX_RATIO = 50  # of counts on one scale
MOST_DOTS = 20
SYMBOLS = {3: "012", 4: ("00", "01", "10", "11")}  # three states carry no whole bits
DOTTED = (1.0, 1.65)
HOP_INCHES, PATH_INCHES = 0.23, 0.3  # of rows
CELL_INCHES = 0.03  # between cells


def rate(begin_ns: int, times_ns: Sequence[int], pairs: Sequence[int], lost: Sequence[int]) -> str:
    """Draw Bell pairs measured a second, and of these the lost ones, from a time on.

    Bins are alike and as many as there are blocks, at most MAX_BINS.
    """
    seconds = (np.array(times_ns) - begin_ns) / 1e9
    span = max(float(seconds[-1]), 1e-6)
    edges = np.linspace(0, span, min(MAX_BINS, len(times_ns)) + 1)
    rates = [
        np.histogram(seconds, edges, weights=each)[0] / np.diff(edges) for each in (pairs, lost)
    ]
    top = 1.05 * max(float(np.max(rates)), 1e-9)
    drawing = Drawing(*SMALL_INCHES)
    upward = ticks(round_values(0, top, 6))
    axes = Axes(drawing, framed(drawing, _words(upward), legend=True), (0, span), (0, top))
    axes.x_axis(ticks(round_values(0, span, 5), "s"), "time since the first pairs were made")
    axes.y_axis(upward, "Bell pairs/s")
    lines = ("measured", QUANTUM, ()), ("lost", BAD, ())
    for found, (_words_of_it, colour, _dashes) in zip(rates, lines, strict=True):
        heights = [0.0, *found.tolist(), 0.0]
        axes.steps([0.0, *edges.tolist()], heights, colour)
    legend(drawing, lines)
    return drawing.svg("Bell pairs a second over time")


def errors(seconds: Sequence[float], counts: Mapping[str, Sequence[int]]) -> str:
    """Draw counts that have grown during the run, as the sender has heard of them."""
    last = [values[-1] for values in counts.values()]
    # Few of one kind beside many of another are seen on a scale of powers of ten.
    powers = max(last) > MAX_RATIO * min((value for value in last if value), default=1)
    scale: Scale = _symmetric if powers else float
    if powers:
        low, top = -0.1, 2.0 * max(last)
        upward = ticks([0, *(10**power for power in range(1 + floor(log10(top))))])
    else:
        top = max(1.0, 1.1 * max(last))
        low, upward = -top / 50, ticks(round_values(0, top, 6, whole=True))  # zeros are seen whole
    span = max(seconds[-1], 1e-6)
    drawing = Drawing(*SMALL_INCHES)
    frame = framed(drawing, _words(upward), legend=True)
    axes = Axes(drawing, frame, (-span / 50, 1.02 * span), (low, top), scale)
    axes.x_axis(ticks(round_values(0, span, 5), "s"), "time since the session began")
    axes.y_axis(upward, "count so far")
    lines = [
        (name, colour, ()) for name, colour in zip(counts, (BAD, METADATA, QUANTUM), strict=False)
    ]
    for (_name, colour, _), values in zip(lines, counts.values(), strict=True):
        axes.steps(seconds, values, colour)
        if len(seconds) < MOST_DOTS:
            for second, value in zip(seconds, values, strict=True):
                drawing.dot(axes.at(second, value), 0.028, colour)
    legend(drawing, lines)
    return drawing.svg("errors over time")


def _symmetric(value: float) -> float:
    """Return the power of ten of a value, plus one; from -1 to 1, the value."""
    return value if abs(value) <= 1 else 1 + log10(value)


def _words(upward: Sequence[Tick]) -> list[str]:
    return [text for _value, text in upward]


def confusion(counts: NDArray[np.int64], states: int) -> str:
    """Draw how often each symbol that was sent was received as which."""
    shown = counts[:states, :states]
    rows = shown.sum(axis=1, keepdims=True)
    shares = shown / np.maximum(rows, 1)
    drawing = Drawing(*SMALL_INCHES)
    axes = Axes(drawing, framed(drawing, SYMBOLS[states]), (0, states), (states, 0))
    width, height = (abs(a - b) for a, b in zip(axes.at(0, 0), axes.at(1, 1), strict=True))
    for sent, received in np.ndindex(shown.shape):
        share, count = float(shares[sent, received]), int(shown[sent, received])
        colour = QUANTUM if sent == received else BAD
        left, top = axes.at(received, sent)
        # A few errors are to be seen beside very many right ones.
        alpha = 0.08 + 0.55 * share ** (1 if sent == received else 0.5) if count else 0.04
        size = width - 2 * CELL_INCHES, height - 2 * CELL_INCHES
        drawing.box((left + CELL_INCHES, top + CELL_INCHES), size, colour, alpha)
        text = f"{count:,}\n{100 * share:.3g} %"
        drawing.text(axes.at(received + 0.5, sent + 0.5), text, size=9)
    names = [(number + 0.5, name) for number, name in enumerate(SYMBOLS[states])]
    axes.x_axis(names, "symbol received", line=False)
    axes.y_axis(names, "symbol sent", line=False)
    return drawing.svg("symbols sent and received")


def loss_budget(paths: Sequence[LightPath], budget_db: float) -> str:
    """Draw what each hop of each path loses, one bar for a hop, and the budget of a path."""
    rows = sum(HOP_INCHES * len(path.hops) + PATH_INCHES for path in paths)
    height = max(SMALL_INCHES[1], 0.75 + rows)
    drawing = Drawing(SMALL_INCHES[0], height)
    most = max(2.2 * max((path.loss_db for path in paths), default=0.0), 1.0)
    # Inches of the drawing are values of y.
    whole = framed(drawing, (), label=False)
    frame = Frame(whole.left, whole.top, whole.right, whole.bottom)
    axes = Axes(drawing, frame, (0, most), (frame.bottom, frame.top))
    text = f"loss (dB); a path may lose {budget_db:g} dB"
    axes.x_axis([(each, f"{each:g}") for each in round_values(0, most, 6)], text)
    y = frame.top + HOP_INCHES / 2
    for path in paths:
        title = f"{path.begin} → {path.end}"
        drawing.text((frame.left, y), title, size=9, align="left", bold=True)
        drawing.text((frame.right, y), f"{path.loss_db:.3g} dB", size=9, align="right")
        before = 0.0
        for hop in path.hops:
            y += HOP_INCHES
            colour = QUANTUM if hop.ends != ("", "") else METADATA
            up, down = y - 0.35 * HOP_INCHES, y + 0.35 * HOP_INCHES
            axes.span((before, before + hop.loss_db), (up, down), colour, 1.0)
            axes.line((before, before), (up, down), colour, 1.5)
            beside = axes.at(before + hop.loss_db, y)[0] + 0.05
            text = f"{hop.name}: {hop.loss_db:.3g} dB"
            drawing.text((beside, y), text, size=9, align="left")
            before += hop.loss_db
        y += PATH_INCHES
    if budget_db <= most:
        axes.across(budget_db, BAD, dashes=DOTTED)
    return drawing.svg("loss of each hop")


def setup_times(times_ms: Sequence[float]) -> str:
    """Draw how often the set-up of a path took how long, with median and 99th percentile."""
    bins = min(40, max(5, ceil(2 * len(times_ms) ** 0.5)))
    found, edges = np.histogram(times_ms, bins)
    low, high = float(edges[0]), float(edges[-1])
    top, margin = 1.05 * int(found.max()), (high - low) / 20
    drawing = Drawing(*SMALL_INCHES)
    upward = ticks(round_values(0, top, 6, whole=True))
    x = low - margin, high + margin
    axes = Axes(drawing, framed(drawing, _words(upward), legend=True), x, (0, top))
    across = [(each, f"{each:.6g}") for each in round_values(*x, 6)]
    axes.x_axis(across, "metadata to light path (ms)")
    axes.y_axis(upward, "light paths")
    for count, begin, end in zip(found.tolist(), edges[:-1], edges[1:], strict=True):
        if count:
            axes.span((float(begin), float(end)), (0, count), METADATA, 0.75)
    lines = []
    for share, dashes in ((50, ()), (99, DOTTED)):
        value = float(np.percentile(times_ms, share))
        axes.across(value, INK, dashes=dashes)
        lines.append((f"p{share} {value:.2f} ms", MUTED, dashes))
    legend(drawing, lines)
    return drawing.svg("how long the set-up of light paths took")
