"""The charts of a run: its rate, errors, symbols, losses, and how long paths took."""

from collections.abc import Mapping, Sequence
from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import EngFormatter, MaxNLocator
from numpy.typing import NDArray

from views.report import drawing
from views.report.drawing import (
    BAD,
    INK,
    LEGEND_INCHES,
    METADATA,
    MUTED,
    OPENFLOW,
    QUANTUM,
    RIGHT_INCHES,
    SMALL_INCHES,
)
from views.report.light_paths import LightPath

KEY_STEPS_INCHES = 1.1
MAX_BINS = 60
MOST_BARS = 30  # of error rates: more are a band
MAX_RATIO = 50  # of counts on one scale
SYMBOLS = {3: "012", 4: ("00 Φ+", "01 Ψ+", "10 Φ-", "11 Ψ-")}  # three states carry no whole bits


Rate = tuple[float, float, float, float]  # a time in seconds, a value and its bounds


@drawing.styled
def rate(begin_ns: int, times_ns: Sequence[int], pairs: Sequence[int], lost: Sequence[int]) -> str:
    """Draw Bell pairs measured a second, and of these the lost ones, from a time on.

    Bins are alike and as many as there are blocks, at most MAX_BINS.
    """
    seconds = (np.array(times_ns) - begin_ns) / 1e9
    span = max(float(seconds[-1]), 1e-6)
    edges = np.linspace(0, span, min(MAX_BINS, len(times_ns)) + 1)
    made, axes = drawing.figure(*SMALL_INCHES, top=LEGEND_INCHES)
    for counts, colour, label in ((pairs, QUANTUM, "measured"), (lost, BAD, "lost")):
        heights, _edges = np.histogram(seconds, edges, weights=counts)
        axes.stairs(heights / np.diff(edges), edges, color=colour, linewidth=1.8, label=label)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("time since the first pairs were made")
    _seconds(axes)
    axes.set_ylabel("Bell pairs/s")
    axes.yaxis.set_major_formatter(EngFormatter())
    made.legend(loc="upper center", ncols=2)
    return drawing.svg(made, "Bell pairs a second over time")


@drawing.styled
def errors(seconds: Sequence[float], counts: Mapping[str, Sequence[int]]) -> str:
    """Draw counts that have grown during the run, as the sender has heard of them."""
    made, axes = drawing.figure(*SMALL_INCHES, top=LEGEND_INCHES)
    for (label, values), colour in zip(counts.items(), (BAD, METADATA, QUANTUM), strict=False):
        marker = "o" if len(seconds) < 20 else ""
        axes.plot(
            seconds,
            values,
            color=colour,
            label=label,
            linewidth=1.8,
            marker=marker,
            markersize=4,
            drawstyle="steps-post",
        )
    last = [values[-1] for values in counts.values()]
    if max(last) > MAX_RATIO * min((value for value in last if value), default=1):
        axes.set_yscale("symlog", linthresh=1)  # few of one kind beside many of another
        axes.set_ylim(-0.1, 2 * max(last))
    else:
        top = max(1.0, 1.1 * max(last))
        axes.set_ylim(-top / 50, top)  # a line of zeros is to be seen whole
        axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=6))
    axes.yaxis.set_major_formatter(EngFormatter())
    axes.set_xlabel("time since the session began")
    _seconds(axes)
    axes.set_ylabel("count so far")
    made.legend(loc="upper center", ncols=len(counts), columnspacing=1)
    return drawing.svg(made, "errors over time")


def _seconds(axes: Axes) -> None:
    axes.xaxis.set_major_locator(MaxNLocator(nbins=6))
    axes.xaxis.set_major_formatter(EngFormatter(unit="s"))


@drawing.styled
def confusion(counts: NDArray[np.int64], states: int) -> str:
    """Draw how often each symbol that was sent was received as which."""
    shown = counts[:states, :states]
    rows = shown.sum(axis=1, keepdims=True)
    shares = shown / np.maximum(rows, 1)
    made, axes = drawing.figure(*SMALL_INCHES)
    drawn = []
    for sent, received in np.ndindex(shown.shape):
        share, count = float(shares[sent, received]), int(shown[sent, received])
        colour = QUANTUM if sent == received else BAD
        # A few errors are to be seen beside very many right ones.
        alpha = 0.08 + 0.55 * share ** (1 if sent == received else 0.5) if count else 0.04
        drawn.append((received, sent, colour, alpha, f"{count:,}\n{100 * share:.3g} %"))
    drawing.cells(axes, SYMBOLS[states], SYMBOLS[states], drawn, size=9)
    axes.set_xlabel("symbol received")
    axes.set_ylabel("symbol sent")
    return drawing.svg(made, "symbols sent and received")


@drawing.styled
def key_steps(counts: Mapping[str, int]) -> str:
    """Draw how much each step of key distribution leaves, on a logarithmic scale."""
    made, axes = drawing.figure(*SMALL_INCHES, left=KEY_STEPS_INCHES)
    places = range(len(counts))
    axes.barh(places, [*counts.values()], color=QUANTUM, height=0.6, alpha=0.6)
    for place, count in zip(places, counts.values(), strict=True):
        axes.annotate(
            f"{count:,}", (max(count, 1), place), (3, 0), textcoords="offset points", va="center"
        )
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(EngFormatter())
    axes.minorticks_off()
    axes.set_xlim(1, 300 * max(counts.values()))
    axes.set_yticks(places, [*counts])
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("photons, then bits")
    return drawing.svg(made, "how much each step of key distribution leaves")


@drawing.styled
def error_rate(rates: Sequence[Rate], most: float) -> str:
    """Draw the error rate of key after key with its interval, and above which there is no key."""
    made, axes = drawing.figure(*SMALL_INCHES)
    seconds, value, low, high = np.array(rates).T * [[1], [100], [100], [100]]
    colour = BAD if value[-1] > 100 * most else QUANTUM
    if len(seconds) > MOST_BARS:
        axes.plot(seconds, value, color=colour, linewidth=1.8)
        axes.fill_between(seconds, low, high, color=colour, alpha=0.2, linewidth=0)
    else:
        axes.errorbar(seconds, value, [value - low, high - value], fmt="o-", color=colour,
                      capsize=4, markersize=5, elinewidth=1.2)  # fmt: skip
    axes.annotate(f"{value[-1]:.3g} %", (seconds[-1], value[-1]), (4, 6),
                  textcoords="offset points")  # fmt: skip
    axes.axhline(100 * most, color=MUTED, linestyle="--", linewidth=1.2)
    axes.annotate(f"no key above {100 * most:g} %", (0.02, 100 * most), (0, 4), color=MUTED,
                  xycoords=axes.get_yaxis_transform(), textcoords="offset points")  # fmt: skip
    axes.set_xlim(0, 1.3 * max(seconds[-1], 1e-9))
    axes.set_ylim(-1, max(30.0, 1.1 * high.max()))
    axes.set_xlabel("time since the session began")
    _seconds(axes)
    axes.set_ylabel("error rate, QBER (%)")
    return drawing.svg(made, "error rate over time, and its threshold")


@drawing.styled
def key_growth(seconds: Sequence[float], counts: Mapping[str, Sequence[int]]) -> str:
    """Draw bits that have grown in number during the session."""
    made, axes = drawing.figure(*SMALL_INCHES, top=LEGEND_INCHES)
    for (label, values), colour in zip(counts.items(), (OPENFLOW, QUANTUM), strict=True):
        axes.plot(seconds, values, color=colour, label=label, linewidth=1.8, drawstyle="steps-post")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.yaxis.set_major_formatter(EngFormatter())
    axes.set_xlabel("time since the session began")
    _seconds(axes)
    axes.set_ylabel("bits so far")
    made.legend(loc="upper center", ncols=2)
    return drawing.svg(made, "sifted and secret bits over time")


@drawing.styled
def loss_budget(paths: Sequence[LightPath], budget_db: float) -> str:
    """Draw what each hop of each path loses, one bar for a hop, and the budget of a path."""
    bars = [(path, hop) for path in paths for hop in path.hops]
    heights = len(bars) + 1.3 * len(paths)
    height = max(SMALL_INCHES[1], 0.75 + 0.23 * heights)
    made, axes = drawing.figure(SMALL_INCHES[0], height, left=RIGHT_INCHES)
    y = 0.0
    for path in paths:
        axes.text(0, y, f"{path.begin} → {path.end}", fontsize=9, weight="bold", va="center")
        axes.text(1, y, f"{path.loss_db:.3g} dB", ha="right", va="center", fontsize=9,
                  transform=axes.get_yaxis_transform())  # fmt: skip
        before = 0.0
        for hop in path.hops:
            y += 1
            colour = QUANTUM if hop.ends != ("", "") else METADATA
            axes.barh(y, hop.loss_db, left=before, height=0.7, color=colour)
            axes.plot([before, before], [y - 0.35, y + 0.35], color=colour, linewidth=1.5)
            text = f"{hop.name}: {hop.loss_db:.3g} dB"
            axes.annotate(
                text,
                (before + hop.loss_db, y),
                (3, 0),
                textcoords="offset points",
                va="center",
                fontsize=9,
            )
            before += hop.loss_db
        y += 1.3
    most = max((path.loss_db for path in paths), default=0.0)
    axes.set_xlim(0, max(2.2 * most, 1.0))
    if budget_db <= max(2.2 * most, 1.0):
        axes.axvline(budget_db, color=BAD, linestyle=":", linewidth=1.5)
    axes.set_ylim(y, -1)
    axes.set_yticks([])
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    axes.set_xlabel(f"loss (dB); a path may lose {budget_db:g} dB")
    return drawing.svg(made, "loss of each hop")


@drawing.styled
def setup_times(times_ms: Sequence[float]) -> str:
    """Draw how often the set-up of a path took how long, with median and 99th percentile."""
    made, axes = drawing.figure(*SMALL_INCHES, top=LEGEND_INCHES)
    bins = min(40, max(5, ceil(2 * len(times_ms) ** 0.5)))
    axes.hist(times_ms, bins=bins, color=METADATA, alpha=0.75)
    for share, style in ((50, "-"), (99, ":")):
        value = float(np.percentile(times_ms, share))
        axes.axvline(
            value, color=INK, linestyle=style, linewidth=1.5, label=f"p{share} {value:.2f} ms"
        )
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=6))
    axes.set_xlabel("path set-up time (ms)")
    axes.set_ylabel("light paths")
    made.legend(loc="upper center", ncols=2, labelcolor=MUTED)
    return drawing.svg(made, "how long the set-up of light paths took")
