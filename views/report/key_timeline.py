"""The time line of keys: error rates of sessions, keys in use, when a tunnel was open, its file."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from views.report import drawing
from views.report.drawing import BAD, INK, METADATA, MUTED, QUANTUM
from wire.results.time_series import FileMoment, KeyMoment, Moment, SessionMoment

MAX_QBER = 0.1  # of sessions of key managers: above it there is no key
TUNNEL = "tunnel"  # how events of it begin
WIDE_INCHES = (9.0, 1.6)  # of each row


@drawing.styled
def key_timeline(series: Sequence[Moment]) -> str:
    tunnel = any(moment.event.startswith(TUNNEL) for moment in series)
    rows = [_sessions, _tunnel, _file] if tunnel else [_sessions]
    width, height = WIDE_INCHES
    made = Figure(figsize=(width, height * len(rows) + 0.6), layout="constrained")
    end = max(moment.at for moment in series)
    every = made.subplots(len(rows), sharex=True, squeeze=False)[:, 0]
    for axes, draw in zip(every, rows, strict=True):
        for begin, over in spans(series, "eve_comes", "eve_leaves", end):
            axes.axvspan(begin, over, color=BAD, alpha=0.12, linewidth=0)
        draw(axes, series, end)
    axes.set_xlabel("time (s)")
    axes.set_xlim(min(0.0, *(moment.at for moment in series)), end)
    return drawing.svg(made, "Keys over time")


def spans(
    series: Sequence[Moment], begins: str, ends: str, end: float
) -> list[tuple[float, float]]:
    """Return from when to when something lasted; what does not end lasts until the end."""
    intervals: list[tuple[float, float]] = []
    since: float | None = None
    for moment in series:
        if moment.event == begins and since is None:
            since = moment.at
        elif moment.event == ends and since is not None:
            intervals.append((since, moment.at))
            since = None
    return intervals if since is None else [*intervals, (since, end)]


def _sessions(axes: Axes, series: Sequence[Moment], _end: float) -> None:
    held = [
        (moment.at, moment.qber, moment.keys > 0)
        for moment in series
        if isinstance(moment, SessionMoment) and moment.opened and moment.qber is not None
    ]
    for with_key, colour, label in ((True, QUANTUM, "key"), (False, BAD, "no key")):
        times = [at for at, _qber, keys in held if keys == with_key]
        rates = [qber for _at, qber, keys in held if keys == with_key]
        axes.plot(times, rates, "o", color=colour, markersize=5, label=label)
    axes.axhline(MAX_QBER, color=MUTED, linewidth=0.9, linestyle="--")
    axes.set_ylabel("QBER")
    axes.set_ylim(bottom=-0.01)
    axes.legend(loc="center left", ncols=2)


def _tunnel(axes: Axes, series: Sequence[Moment], end: float) -> None:
    hosts = sorted({moment.host for moment in series if moment.event.startswith(TUNNEL)})
    for row, host in enumerate(reversed(hosts)):
        of_host = [moment for moment in series if moment.host == host]
        open_spans = spans(of_host, "tunnel_opened", "tunnel_closed", end)
        bars = [(begin, over - begin) for begin, over in open_spans]
        axes.broken_barh(bars, (row - 0.3, 0.6), color=METADATA, alpha=0.35)
        keys = [moment.at for moment in of_host if isinstance(moment, KeyMoment)]
        axes.plot(keys, [row] * len(keys), "|", color=INK, markersize=12)
    axes.set_yticks(range(len(hosts)), reversed(hosts))
    axes.set_ylim(-0.6, len(hosts) - 0.4)
    axes.set_ylabel("tunnel, keys")


def _file(axes: Axes, series: Sequence[Moment], _end: float) -> None:
    parts = [moment for moment in series if isinstance(moment, FileMoment)]
    megabytes = [part.bytes / 1e6 for part in parts]
    axes.plot([part.at for part in parts], megabytes, color=METADATA, linewidth=1.8)
    axes.set_ylabel("file (MB)")
    axes.set_ylim(bottom=0)
