"""The picture of who waited for whose light: a square for each two hosts."""

from collections import defaultdict
from collections.abc import Sequence

from matplotlib.patches import Rectangle

from views.report import drawing
from views.report.drawing import INK, METADATA
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
    found: Waited = {}
    for each in waits:
        pair = each.opener, each.after_opener
        if shown.issuperset(pair):
            found[pair] = found.get(pair, 0.0) + each.waited_s
    return found


@drawing.styled
def waits_diagram(waits: Sequence[LoadWait]) -> str:
    """Draw a row for each host whose sessions waited, and a column for each they waited for."""
    found = waited(waits)
    rows, columns = (sorted({pair[place] for pair in found}) for place in (0, 1))
    height = REST_INCHES + ROW_INCHES * len(rows)
    made, axes = drawing.figure(WIDTH_INCHES, height, left=LABEL_INCHES)
    axes.grid(visible=False)
    most = max(found.values())
    for (waiter, holder), seconds in found.items():
        x, y = columns.index(holder), rows.index(waiter)
        # Short waits are to be seen beside long ones.
        alpha = 0.08 + 0.6 * (seconds / most) ** 0.5
        corner = (x - 0.46, y - 0.44)
        axes.add_patch(Rectangle(corner, 0.92, 0.88, facecolor=METADATA, alpha=alpha))
        axes.text(x, y, f"{seconds:.2g}", ha="center", va="center", color=INK, fontsize=8)
    axes.set_xlim(-0.5, len(columns) - 0.5)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xticks(range(len(columns)), columns, fontsize=8)
    axes.set_yticks(range(len(rows)), rows, fontsize=8)
    axes.set_xlabel("for the light of")
    axes.set_ylabel("who waited")
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    return drawing.svg(made, "who waited for whose light, in seconds")
