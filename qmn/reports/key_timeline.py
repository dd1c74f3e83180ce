"""The time line of keys: error rates of sessions, keys in use, when a tunnel was open, its file."""

from collections.abc import Sequence
from typing import Any

from hosts.middleware.services.key_distribution.options import KeyOptions
from qmn.reports.axes import Axes, Frame, legend, round_values
from qmn.reports.drawing import BAD, INK, METADATA, MUTED, QUANTUM, Drawing

Moment = dict[str, Any]
WIDE_INCHES, ROW_INCHES, REST_INCHES = 9.0, 1.5, 0.9
SPACE_INCHES = 0.15  # between rows
LEFT_INCHES = 0.9  # for labels and numbers of all rows
DASHED = 3.0, 2.0


def key_timeline(moments: Sequence[Moment]) -> str:
    """Draw what happened to keys, and to a tunnel if there was one."""
    tunnel = any(each["event"].startswith("tunnel") for each in moments)
    rows = [_sessions, _tunnel, _file] if tunnel else [_sessions]
    drawing = Drawing(WIDE_INCHES, ROW_INCHES * len(rows) + REST_INCHES)
    end = max(each["at"] for each in moments)
    begin = min(0.0, *(each["at"] for each in moments))
    x = begin, max(end, begin + 1e-3)
    top = 0.35
    for draw in rows:
        frame = Frame(LEFT_INCHES, top, WIDE_INCHES - 0.2, top + ROW_INCHES - SPACE_INCHES)
        axes = draw(drawing, frame, x, moments)
        low, high = axes.y_ends
        for since, until in spans(moments, "eve_comes", "eve_leaves", end):
            axes.span((since, until), (low, high), BAD, 0.12)
        seconds = [(each, f"{each:g}") for each in round_values(*x, 8)]
        is_last = draw is rows[-1]
        axes.x_axis(
            [(each, text if is_last else "") for each, text in seconds],
            "time (s)" if is_last else "",
        )
        top += ROW_INCHES
    legend(drawing, [("key", QUANTUM, ()), ("no key", BAD, ())])
    return drawing.svg("Keys over time")


def spans(
    moments: Sequence[Moment], begins: str, ends: str, end: float
) -> list[tuple[float, float]]:
    """Return from when to when something lasted; what does not end lasts until the end."""
    found, since = [], None
    for moment in moments:
        if moment["event"] == begins and since is None:
            since = moment["at"]
        elif moment["event"] == ends and since is not None:
            found.append((since, moment["at"]))
            since = None
    return found if since is None else [*found, (since, end)]


def _sessions(
    drawing: Drawing, frame: Frame, x: tuple[float, float], moments: Sequence[Moment]
) -> Axes:
    held = [each for each in moments if each.get("opened") and each["qber"] is not None]
    most = max([KeyOptions.max_qber, *(each["qber"] for each in held)])
    axes = Axes(drawing, frame, x, (-0.01, 1.1 * most))
    axes.y_axis([(each, f"{each:g}") for each in round_values(0, 1.1 * most, 5)], "QBER")
    axes.along(KeyOptions.max_qber, MUTED, 0.9, DASHED)
    for each in held:
        drawing.dot(axes.at(each["at"], each["qber"]), 0.035, QUANTUM if each["keys"] > 0 else BAD)
    return axes


def _tunnel(
    drawing: Drawing, frame: Frame, x: tuple[float, float], moments: Sequence[Moment]
) -> Axes:
    hosts = sorted({each["host"] for each in moments if each["event"].startswith("tunnel")})
    axes = Axes(drawing, frame, x, (len(hosts) - 0.4, -0.6))
    for row, host in enumerate(hosts):
        own = [each for each in moments if each.get("host") == host]
        for since, until in spans(own, "tunnel_opened", "tunnel_closed", x[1]):
            axes.span((since, until), (row - 0.3, row + 0.3), METADATA, 0.35)
        for key in (each["at"] for each in own if each["event"] == "key"):
            axes.line((key, key), (row - 0.2, row + 0.2), INK, 1.0)
    axes.y_axis([*enumerate(hosts)], "tunnel, keys")
    return axes


def _file(
    drawing: Drawing, frame: Frame, x: tuple[float, float], moments: Sequence[Moment]
) -> Axes:
    told = [each for each in moments if each["event"] in ("received", "downloaded")]
    megabytes = [each["bytes"] / 1e6 for each in told]
    top = 1.1 * max([*megabytes, 1e-3])
    axes = Axes(drawing, frame, x, (0, top))
    axes.y_axis([(each, f"{each:g}") for each in round_values(0, top, 5)], "file (MB)")
    axes.line([each["at"] for each in told], megabytes, METADATA)
    return axes
