"""The chain of a swapped pair: its nodes, and how old their qubits were when they were used."""

import re
from collections.abc import Iterable, Sequence

from views.report import drawing
from views.report.drawing import INK, METADATA, MUTED, PAPER, QUANTUM
from wire.dispatcher_pb2 import Event

USED = ("recall", "wait")  # kinds of events that tell an age
AGE = re.compile(r"after (?:[\d.]+ to )?([\d.]+) s")
HALVES = (0, 1)
WIDTH_INCHES, HEIGHT_INCHES = 9.0, 1.9
MOST_NODES = 12
Ages = dict[tuple[str, int], float]  # of a node's half of a link, the oldest, in s


def chain_of(events: Iterable[Event], begin: str) -> tuple[list[str], Ages]:
    """Return the nodes in their order, by the links that events are of, and ages of qubits."""
    # Which node has which half, by session; numbers of both ends' own blocks alternate.
    links: dict[tuple[int, int], dict[int, str]] = {}
    ages: Ages = {}
    for event in events:
        if event.kind not in (*USED, "store") or event.block.half not in HALVES:
            continue
        node, block = event.node.partition("-")[0], event.block  # of a switch: its memory
        link = links.setdefault((block.session, block.number % 2), {})
        link.setdefault(block.half, node)
        if event.kind in USED and (match := AGE.search(event.detail)):
            key = node, block.session
            ages[key] = max(ages.get(key, 0.0), float(match[1]))
    ends = [tuple(link.values()) for _session, link in sorted(links.items()) if len(link) == 2]
    nodes = [begin]
    while follower := _follower(ends, nodes):
        nodes.append(follower)
    return nodes, ages


def _follower(links: Sequence[tuple[str, ...]], nodes: Sequence[str]) -> str:
    """Return the node behind the last; "" if it is the end."""
    for link in reversed(links):  # those of the chain come after that of its ends
        if nodes[-1] in link:
            (other,) = {*link} - {nodes[-1]} or {nodes[-1]}
            if other not in nodes:
                return other
    return ""


@drawing.styled
def chain_diagram(nodes: Sequence[str], ages: Ages) -> str:
    """Draw nodes in a row, and under each the age of its oldest qubit in use."""
    made, axes = drawing.diagram(WIDTH_INCHES, HEIGHT_INCHES)
    step = WIDTH_INCHES / len(nodes)
    oldest = {
        name: max((a for (n, _), a in ages.items() if n == name), default=None) for name in nodes
    }
    longest = max((age for age in oldest.values() if age), default=0.0) or 1.0
    axes.plot([step / 2, WIDTH_INCHES - step / 2], [0.5, 0.5], color=QUANTUM, linewidth=2)
    for number, name in enumerate(nodes):
        x, age = step * (number + 0.5), oldest[name]
        box = {"boxstyle": "round,pad=0.5", "facecolor": PAPER, "edgecolor": INK}
        axes.text(x, 0.5, name, ha="center", va="center", bbox=box)
        if age is None:
            continue
        axes.barh(1.1, 0.8 * step * age / longest, left=x - 0.4 * step, height=0.14, color=METADATA)
        axes.text(x, 1.45, f"{1e3 * age:.3g} ms", ha="center", va="center", color=MUTED)
    return drawing.svg(made, "the chain of nodes, and the ages of their qubits")
