"""Refusals of device settings that nothing in a job feels, by name and with the setting that acts.

--device alice.source.fidelity=0.9, in bb84: alice makes no pairs there, and prepares states
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from qmn.network.light_checks import making
from qmn.options import BadInput
from topologies.description.description import Description
from wire.metadata.vocabulary import Service
from wire.services import LINES, Making, uses_source

OF_PAIRS = frozenset({"source.fidelity", "source.bell_diagonal"})
OF_STATES = frozenset({"source.preparation_error"})
OF_PROGRAMS = frozenset({"gates.initialization_error", "gates.initialization_s"})
PREPARED_BY_OPENER = frozenset({Service.BB84, Service.TELEPORT})


@dataclass(frozen=True)
class Emitters:
    """The hosts of a job whose sources emit."""

    hosts: frozenset[str]  # all of the job
    pairs: frozenset[str]
    states: frozenset[str]

    def __or__(self, other: "Emitters") -> "Emitters":
        """Return those of two sessions."""
        sets = zip(vars(self).values(), vars(other).values(), strict=True)
        return Emitters(*(mine | theirs for mine, theirs in sets))


def emitters_of(
    service: str, hosts: Sequence[str], parts: Description, source: str = "", separate: bool = False
) -> Emitters:
    """Return who makes pairs, and who prepares states, of the hosts that take part in a service.

    `source` makes the pairs, if a user names it; separate: each host makes probes of its own.
    """
    asked, opener = Service[service.upper()], hosts[0]
    maker = source or parts.source_for(opener)
    by = making(asked, opener, maker, parts)
    third = {maker} if uses_source(asked, by) else set()
    pairs, states = set[str](), set[str]()
    if separate or asked == Service.MDI:
        states |= set(hosts)
    elif asked == Service.SWAP:  # any host may be a repeater
        pairs |= set(parts.hosts) - {hosts[-1]}
    elif asked in LINES:
        pairs |= set(hosts[:-1])
    elif asked != Service.BB84:
        pairs |= {Making.OPENER: {opener}, Making.SOURCE: third, Making.STATION: set()}[by]
    if asked in PREPARED_BY_OPENER:
        states.add(opener)
    return Emitters(frozenset({*hosts, *third}), frozenset(pairs), frozenset(states))


def check_settings(service: str, emitters: Emitters, words: Collection[str]) -> None:
    """Raise BadInput for a word HOST.PART.NAME=VALUE that changes nothing in a job."""
    for word in words:
        host, _dot, setting = word.partition("=")[0].partition(".")
        if host not in emitters.hosts:
            continue
        if setting in OF_PROGRAMS:
            text = f"no qubit is made in |0> in {service}, as programs do (qmn netqasm)"
            raise BadInput(f"--device {word}: {text}: leave it out")
        if setting in OF_PAIRS and host not in emitters.pairs:
            raise BadInput(f"--device {word}: {_no_pairs(service, host, emitters)}")
        if setting in OF_STATES and host not in emitters.states:
            text = f"{host} prepares no states in {service}"
            if host in emitters.pairs:
                text += f", and its pairs err by {host}.source.fidelity: give that"
            raise BadInput(f"--device {word}: {text}")


def _no_pairs(service: str, host: str, emitters: Emitters) -> str:
    text = f"{host} makes no pairs in {service}"
    if host in emitters.states:
        return f"{text}, and its states err by {host}.source.preparation_error: give that"
    makers = ", ".join(sorted(emitters.pairs))
    return f"{text}: give it for {makers}" if makers else text
