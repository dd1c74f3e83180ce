"""Curves of whole networks: light that sessions contend for, and seals."""

from collections.abc import Sequence

from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.figure import Mark
from evidence.curves.links import routes
from evidence.curves.seal import error, question
from evidence.curves.sheet import Curve, Sheet
from evidence.curves.wald import wald_pairs_to_alarm
from evidence.traffic.erlang import reduced_load


def wald_marks(fractions: Sequence[float]) -> list[Mark]:
    """Return Wald's expected sample numbers of a tamper seal at these fractions."""
    complete = EXPERIMENTS["seal"].complete
    points = [complete({"tapped": fraction}) for fraction in fractions]
    pairs = [wald_pairs_to_alarm(question(values), error(values)) for values in points]
    labels = ["Wald's approximations (1945)", *[""] * (len(points) - 1)]  # one in the legend
    places = zip(fractions, pairs, labels, strict=True)
    return [Mark(fraction, each, 0.0, label) for fraction, each, label in places]


def reduced_load_marks(loads: Sequence[float], links: int) -> list[Mark]:
    """Return the reduced-load approximation of sessions over a chain of links at these loads."""
    complete = EXPERIMENTS["links"].complete
    points = [complete({"load": load, "links": links}) for load in loads]
    shares = [reduced_load(*routes(values))[0] for values in points]
    labels = [f"reduced load, {links} links", *[""] * (len(loads) - 1)]  # one in the legend
    return [Mark(*each[:2], 0.0, each[2]) for each in zip(loads, shares, labels, strict=True)]


TAPPED = (0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0)
LOADS = (0.5, 1.0, 2.0, 4.0, 6.0, 8.0)  # erlang

NETWORK_SHEETS = (
    Sheet(
        "blocking",
        "light",
        {
            "load": [0.5, 1.0, 2.0, 4.0, 6.0, 8.0],
            "channels": [1, 4],
            "holding": ["exponential", "constant"],
            "sessions": 5_000,
        },
        [
            Curve(
                "erlang-b",
                "Sessions refused on a trunk of fibres: Erlang B",
                "load",
                "arrivals in a mean holding time (erlang)",
                "blocked",
                by=["channels", "holding"],
            )
        ],
    ),
    Sheet(
        "links",
        "links",
        {"load": list(LOADS), "links": [1, 3], "sessions": 10_000},
        [
            Curve(
                "links-through",
                "Sessions refused that pass a chain of links, beside those of each link",
                "load",
                "load of each link, half of it of sessions that pass all (erlang)",
                "through",
                by=["links"],
                marks=reduced_load_marks(LOADS, 3),
            ),
            Curve(
                "links-one",
                "Sessions of the first link refused, beside those that pass the whole chain",
                "load",
                "load of each link, half of it of sessions that pass all (erlang)",
                "one_link",
                by=["links"],
            ),
        ],
    ),
    Sheet(
        "several-fibers",
        "several-fibers",
        {"load": list(LOADS), "channels": [4, 8], "sessions": 10_000},
        [
            Curve(
                f"kaufman-roberts-{measure}",
                f"Sessions of {text} refused on a trunk: Kaufman and Roberts",
                "load",
                "fibres that are asked for in a mean holding time (erlang)",
                measure,
                by=["channels"],
            )
            for measure, text in (("narrow", "one fibre"), ("wide", "two fibres"))
        ],
    ),
    *(
        Sheet(
            f"queueing-{channels}",
            "light",
            {
                "load": [channels * share for share in (0.2, 0.4, 0.6, 0.7, 0.8)],
                "channels": [channels],
                "contention": ["queue"],
                "sessions": 10_000,
            },
            [
                Curve(
                    f"erlang-c-{measure}-{channels}",
                    f"{text} on a trunk of {channels} fibres: Erlang C",
                    "load",
                    "arrivals in a mean holding time (erlang)",
                    measure,
                )
                for measure, text in (("waited", "Sessions that wait"), ("wait", "Mean wait"))
            ],
        )
        for channels in (1, 4)
    ),
    Sheet(
        "schedulers",
        "schedule",
        {
            "rate_per_s": [5.0, 10.0, 20.0, 30.0, 45.0, 60.0],
            "order": ["fcfs", "edf", "slots"],
            "sessions": 2_000,
        },
        [
            Curve(
                f"schedulers-{measure}",
                f"{text} on the map of GARR, signalling included",
                "rate_per_s",
                "requests/s",
                measure,
                by=["order"],
            )
            for measure, text in (
                ("in_time", "Requests that have light in time"),
                ("urgent_in_time", "Urgent requests that have light in time"),
            )
        ],
    ),
    Sheet(
        "seal",
        "seal",
        {"tapped": list(TAPPED)},
        [
            Curve(
                "seal",
                "A tamper seal: pairs compared until the alarm, enumerated",
                "tapped",
                "fraction of the photons that is measured and resent",
                "pairs",
                marks=wald_marks(TAPPED),
            )
        ],
    ),
)
