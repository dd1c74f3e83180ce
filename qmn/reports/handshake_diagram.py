"""The drawing of a handshake: both layers on one clock."""

from collections.abc import Sequence

from qmn.reports import sequence as layers
from qmn.reports.drawing import BAD, GRID, METADATA, MUTED, OPENFLOW, QUANTUM, Drawing
from qmn.reports.places import Place
from qmn.reports.sequence import Step

COLOURS = {layers.METADATA: METADATA, layers.OPENFLOW: OPENFLOW, layers.QUANTUM: QUANTUM}
ROW_INCHES, LANE_INCHES, TIMES_INCHES, HEAD_INCHES = 0.24, 1.75, 0.75, 0.45
LETTER_INCHES = 0.06


def handshake_diagram(steps: Sequence[Step], names: Sequence[str]) -> str:
    """Draw who sent what to whom; every row is a moment, with its time on the left."""
    moments = _moments(steps)
    rows = {moment: row for row, moment in enumerate(moments)}
    width = TIMES_INCHES + LANE_INCHES * len(names)
    height = HEAD_INCHES + ROW_INCHES * (len(moments) + 1)
    drawing = Drawing(width, height)
    places = {name: TIMES_INCHES + LANE_INCHES * (n + 0.5) for n, name in enumerate(names)}
    for name, x in places.items():
        drawing.line([(x, HEAD_INCHES), (x, height)], GRID, 1.2)
        drawing.text((x, HEAD_INCHES / 2), name, size=11, bold=True)
    origin = moments[0][0]
    for moment, row in rows.items():
        text = f"{(moment[0] - origin) / 1e6:.3f} ms"
        drawing.text((TIMES_INCHES, _height(row)), text, MUTED, size=8, align="right")
    for number, step in enumerate(steps):
        y1 = _height(rows[step.time_ns, number])
        y2 = y1 if step.arrival_ns is None else _height(rows[step.arrival_ns, number])
        _step(drawing, step, (places[step.lane], y1), (places[step.to_lane or step.lane], y2))
    return drawing.svg("the handshake: packets and quantum events in time order")


def _moments(steps: Sequence[Step]) -> list[tuple[int, int]]:
    """Return every time of every step, in order, each with the number of its step."""
    begun = [(step.time_ns, number) for number, step in enumerate(steps)]
    ended = [(s.arrival_ns, number) for number, s in enumerate(steps) if s.arrival_ns is not None]
    return sorted(begun + ended)


def _height(row: int) -> float:
    return HEAD_INCHES + ROW_INCHES * (row + 0.5)


def _step(drawing: Drawing, step: Step, begin: Place, end: Place) -> None:
    colour = COLOURS[step.layer]
    lost = step.to_lane and step.layer == layers.METADATA and step.arrival_ns is None
    if step.to_lane:
        width, dashes = (1.6, (1, 1.5)) if step.layer == layers.QUANTUM else (1.2, ())
        drawing.arrow(begin, end, BAD if lost else colour, width, dashes)
    else:
        drawing.dot(begin, 0.05, colour)
    fits = begin[0] + 0.1 + LETTER_INCHES * len(step.text) < drawing.width
    right = end[0] > begin[0] or (not step.to_lane and fits)
    above = bool(step.to_lane)
    place = begin[0] + (0.1 if right else -0.1), begin[1] - (0.04 if above else 0)
    drawing.text(place, step.text, colour, 8, "left" if right else "right", above)
