"""The axes of a chart: scales, ticks with their numbers, and what is drawn at values of both."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import ceil, floor, log10

from qmn.reports.drawing import GRID, MUTED, Drawing
from qmn.reports.places import Place

SMALL_INCHES = (4.4, 3.0)  # a chart: two beside each other, or one on a phone
LETTER_INCHES = 0.075  # of the size of ticks and labels, about
LABEL_INCHES, TICK_INCHES = 0.28, 0.22  # that a label and the numbers at ticks take
LEGEND_INCHES, SAMPLE_INCHES = 0.32, 0.3
MARGIN_INCHES = 0.12
WIDTH = 1.8  # of lines, in points
STEPS = (1, 2, 5)
PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
Tick = tuple[float, str]
Scale = Callable[[float], float]


@dataclass(frozen=True)
class Frame:
    """Where axes are in a drawing, in inches."""

    left: float
    top: float
    right: float
    bottom: float


def framed(
    drawing: Drawing, numbers: Iterable[str], legend: bool = False, label: bool = True
) -> Frame:
    """Return the room for axes with such numbers on the left, in the whole of a drawing."""
    left = MARGIN_INCHES + LABEL_INCHES * label
    left += LETTER_INCHES * max(map(len, numbers), default=0)
    return Frame(
        left,
        MARGIN_INCHES + LEGEND_INCHES * legend,
        drawing.width - 2 * MARGIN_INCHES,
        drawing.height - MARGIN_INCHES - LABEL_INCHES - TICK_INCHES,
    )


class Axes:
    """A part of a drawing in which places are values of x and y, each from one end to another."""

    def __init__(
        self,
        drawing: Drawing,
        frame: Frame,
        x: tuple[float, float],
        y: tuple[float, float],
        y_scale: Scale = float,
    ) -> None:
        self.drawing, self.frame, self.y_ends = drawing, frame, y
        self._x, self._y, self._y_scale = x, (y_scale(y[0]), y_scale(y[1])), y_scale

    def at(self, x: float, y: float) -> Place:
        """Return the place of two values."""
        frame, (x0, x1), (y0, y1) = self.frame, self._x, self._y
        share_x, share_y = (x - x0) / (x1 - x0), (self._y_scale(y) - y0) / (y1 - y0)
        return (
            frame.left + share_x * (frame.right - frame.left),
            frame.bottom - share_y * (frame.bottom - frame.top),
        )

    def x_axis(self, ticks: Sequence[Tick], label: str = "", line: bool = True) -> None:
        """Draw the lower axis, and its grid."""
        frame = self.frame
        for value, text in ticks:
            x = self.at(value, 0.0)[0]
            if line:
                self.drawing.line([(x, frame.top), (x, frame.bottom)], GRID, 0.8)
            self.drawing.text((x, frame.bottom + TICK_INCHES / 2), text)
        if line:
            self.drawing.line([(frame.left, frame.bottom), (frame.right, frame.bottom)], MUTED)
        middle = (frame.left + frame.right) / 2
        below = frame.bottom + TICK_INCHES + LABEL_INCHES / 2
        self.drawing.text((middle, below), label)

    def y_axis(
        self, ticks: Sequence[Tick], label: str = "", line: bool = True, size: float = 10.0
    ) -> None:
        """Draw the left axis, and its grid."""
        frame = self.frame
        for value, text in ticks:
            y = self.at(self._x[0], value)[1]
            if line:
                self.drawing.line([(frame.left, y), (frame.right, y)], GRID, 0.8)
            self.drawing.text((frame.left - 0.06, y), text, size=size, align="right")
        if line:
            self.drawing.line([(frame.left, frame.top), (frame.left, frame.bottom)], MUTED)
        if label:
            place = MARGIN_INCHES + LABEL_INCHES / 3, (frame.top + frame.bottom) / 2
            self.drawing.text(place, label, turned=90)

    def line(
        self,
        xs: Sequence[float],
        ys: Sequence[float],
        colour: str,
        width: float = WIDTH,
        dashes: Sequence[float] = (),
    ) -> None:
        """Draw a line through values."""
        self.drawing.line(
            [self.at(x, y) for x, y in zip(xs, ys, strict=True)], colour, width, dashes
        )

    def steps(
        self, xs: Sequence[float], ys: Sequence[float], colour: str, width: float = WIDTH
    ) -> None:
        """Draw values each of which holds until the next."""
        corners = [(x, y) for x, y in zip(xs, ys, strict=True) for _ in range(2)]
        places = [self.at(x, y) for (x, _), (_, y) in zip(corners[1:], corners, strict=False)]
        self.drawing.line(places, colour, width)

    def across(
        self, x: float, colour: str, width: float = 1.5, dashes: Sequence[float] = ()
    ) -> None:
        """Draw a line at a value of x, from below to above."""
        place, frame = self.at(x, 0.0)[0], self.frame
        self.drawing.line([(place, frame.bottom), (place, frame.top)], colour, width, dashes)

    def along(
        self, y: float, colour: str, width: float = 1.5, dashes: Sequence[float] = ()
    ) -> None:
        """Draw a line at a value of y, from left to right."""
        place, frame = self.at(self._x[0], y)[1], self.frame
        self.drawing.line([(frame.left, place), (frame.right, place)], colour, width, dashes)

    def span(
        self, x: tuple[float, float], y: tuple[float, float], colour: str, alpha: float
    ) -> None:
        """Fill all between two values of x and two of y."""
        (x0, y0), (x1, y1) = self.at(x[0], y[0]), self.at(x[1], y[1])
        corner = min(x0, x1), min(y0, y1)
        self.drawing.box(corner, (abs(x1 - x0), abs(y1 - y0)), colour, alpha)


def legend(drawing: Drawing, entries: Sequence[tuple[str, str, Sequence[float]]]) -> None:
    """Write what lines mean above all, in a row: their words, colours and dashes."""
    widths = [SAMPLE_INCHES + 0.2 + 0.9 * LETTER_INCHES * len(words) for words, *_ in entries]
    x, y = (drawing.width - sum(widths) + 0.15) / 2, MARGIN_INCHES + LEGEND_INCHES / 3
    for (words, colour, dashes), width in zip(entries, widths, strict=True):
        drawing.line([(x, y), (x + SAMPLE_INCHES - 0.05, y)], colour, WIDTH, dashes)
        drawing.text((x + SAMPLE_INCHES, y), words, size=9, align="left")
        x += width


def round_values(low: float, high: float, most: int, whole: bool = False) -> list[float]:
    """Return round values from one to another, at most so many intervals; perhaps whole ones."""
    least = (high - low) / most
    exponent = floor(log10(least))
    steps = (n * 10.0**power for power in (exponent, exponent + 1) for n in STEPS)
    step = next(each for each in steps if each >= least * (1 - 1e-9))
    step = max(step, 1.0) if whole else step
    first, last = ceil(low / step - 1e-9), floor(high / step + 1e-9)
    return [number * step for number in range(first, last + 1)]


def engineering(value: float, unit: str = "") -> str:
    """Return a number with a prefix of the SI, as 1.5 M, or 300 µs with its unit."""
    power = 3 * floor(log10(abs(value)) / 3 + 1e-9) if value else 0
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    text = f"{value / 10.0**power:.6g}"
    after = f"{PREFIXES[power]}{unit}"
    return f"{text} {after}" if after else text


def ticks(values: Iterable[float], unit: str = "") -> list[Tick]:
    """Return ticks at values, with their numbers."""
    return [(value, engineering(value, unit)) for value in values]
