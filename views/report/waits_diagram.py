"""The picture of who waited for whose light: a square for each two hosts."""

from collections import defaultdict
from collections.abc import Sequence

from views.report import drawing
from views.report.drawing import METADATA
from wire.results.run_result import LoadWait

MOST_HOSTS = 16
WIDTH_INCHES, ROW_INCHES, LABEL_INCHES, REST_INCHES = 8.6, 0.26, 1.1, 0.7
Waited = dict[tuple[str, str], float]  # seconds, by who waited, and for whom


def waited(waits: Sequence[LoadWait]) -> Waited:
    shares: defaultdict[str, float] = defaultdict(float)
    for each in waits:
        for host in {each.opener, each.after_opener}:
            shares[host] += each.waited_s
    shown = set(sorted(shares, key=shares.__getitem__, reverse=True)[:MOST_HOSTS])
    by_pair: Waited = {}
    for each in waits:
        pair = each.opener, each.after_opener
        if shown.issuperset(pair):
            by_pair[pair] = by_pair.get(pair, 0.0) + each.waited_s
    return by_pair


@drawing.styled
def waits_diagram(waits: Sequence[LoadWait]) -> str:
    """Draw a row for each host whose sessions waited, and a column for each they waited for."""
    by_pair = waited(waits)
    rows, columns = (sorted({pair[place] for pair in by_pair}) for place in (0, 1))
    height = REST_INCHES + ROW_INCHES * len(rows)
    made, axes = drawing.figure(WIDTH_INCHES, height, left=LABEL_INCHES)
    most = max(by_pair.values())
    drawn = []
    for (waiter, holder), seconds in by_pair.items():
        alpha = 0.08 + 0.6 * (seconds / most) ** 0.5  # short waits show beside long ones
        place = columns.index(holder), rows.index(waiter)
        drawn.append((*place, METADATA, alpha, f"{seconds:.2g}"))
    drawing.cells(axes, columns, rows, drawn, size=8)
    axes.set_xlabel("for the light of")
    axes.set_ylabel("who waited")
    return drawing.svg(made, "who waited for whose light, in seconds")
