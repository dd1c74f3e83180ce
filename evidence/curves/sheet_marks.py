"""Marks and limits of sheets that formulas give: sheets.toml names them."""

from collections.abc import Callable, Iterable, Mapping, Sequence

from evidence.curves import relay_theory, relayed_keys, theory
from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.figure import Limit, Mark
from evidence.curves.links import routes
from evidence.curves.parameters import Value
from evidence.curves.seal import error, question
from evidence.curves.sensing import limits
from evidence.curves.wald import wald_pairs_to_alarm
from evidence.traffic.erlang import reduced_load

LINKS = 3


def experiment(_places: Sequence[float]) -> list[Mark]:
    label = "experiment, arXiv:1609.00713\n(at the p of this capacity)"
    return [Mark(theory.EXPERIMENT_P, *theory.EXPERIMENT_BITS, label)]


def endless_decoys(lengths_km: Sequence[float]) -> list[Mark]:
    mean = relayed_keys.SIGNAL
    noise = relayed_keys.DARK_COUNT, relayed_keys.ERROR, relayed_keys.CORRECTION
    arriving = map(relayed_keys.arrives, lengths_km)
    keys = [relay_theory.endless_key(mean, share, *noise) for share in arriving]
    return line(lengths_km, keys, "endless decoys, Phys. Rev. Lett. 108, 130503")


def wald(fractions: Sequence[float]) -> list[Mark]:
    points = [EXPERIMENTS["seal"].complete({"tapped": fraction}) for fraction in fractions]
    pairs = [wald_pairs_to_alarm(question(values), error(values)) for values in points]
    return line(fractions, pairs, "Wald's approximations (1945)")


def reduced_loads(loads: Sequence[float]) -> list[Mark]:
    given: list[dict[str, Value]] = [{"load": load, "links": LINKS} for load in loads]
    points = map(EXPERIMENTS["links"].complete, given)
    shares = [reduced_load(*routes(values))[0] for values in points]
    return line(loads, shares, f"reduced load, {LINKS} links")


def line(places: Sequence[float], values: Iterable[float], label: str) -> list[Mark]:
    labels = [label, *[""] * (len(places) - 1)]
    return [Mark(*each[:2], 0.0, each[2]) for each in zip(places, values, labels, strict=True)]


def sensing(sensors: Sequence[int], probes: int) -> list[Limit]:
    names = "Heisenberg's limit 1/(N sqrt M)", "standard quantum limit 1/sqrt(N M)"
    lines = zip(*(limits(hosts, probes) for hosts in sensors), strict=True)
    return [
        Limit(name, list(zip(sensors, values, strict=True)))
        for name, values in zip(names, lines, strict=True)
    ]


MARKS: Mapping[str, Callable[[Sequence[float]], list[Mark]]] = {
    "experiment": experiment,
    "endless decoys": endless_decoys,
    "wald": wald,
    "reduced loads": reduced_loads,
}
