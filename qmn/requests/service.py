"""The request of a service that is about a number of things, as states or pairs."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from controller_apps.policy.schedules import PARALLEL, SCHEDULES
from hosts.middleware.services import named
from hosts.middleware.session.options import ServiceOptions
from qmn.network.options import NetworkOptions
from qmn.options import from_keywords
from qmn.requests.run_options import RunOptions
from qmn.requests.service_verbs import SERVICE_PORT, Verb, verb_of
from wire.device import MAX_LEVEL_ROUNDS
from wire.parameters.option import option, recorded_as
from wire.socket_calls import ATTACKS, RESEND


@dataclass(frozen=True, kw_only=True)
class SenderOptions:
    """The two ends, if no line of hosts names them."""

    sender: str = option(
        "alice", "host that opens the session (alice)", flag="--from", metavar="HOST"
    )


@dataclass(frozen=True, kw_only=True)
class BlockOptions:
    """In place of the session's, which are recorded; None: such that every source can make it."""

    block_pairs: int | None = option(None, "pairs in a block", metavar="N", recorded=False)
    rate_hz: int | None = option(None, "of the source", metavar="HZ", recorded=False)


@dataclass(frozen=True, kw_only=True)
class EavesdropperOptions:
    """Whether there is an eavesdropper, and what she does."""

    eve: float | None = option(
        None,
        "put eve on the fibre; she attacks this fraction of the photons",
        metavar="FRACTION",
        range=(0.0, 1),
    )
    eve_attack: str = option(
        RESEND,
        f"what she does: measure and resend, or split photons off pulses of several ({RESEND})",
        choices=ATTACKS,
        of="eve",
    )
    eve_hides_db: float | None = option(
        None,
        "split: by how much less light is lost from her to a click than both ends expect (0)",
        metavar="DB",
        range=(0.0, 100),
    )


@dataclass(frozen=True, kw_only=True)
class HandOutOptions:
    """The use of keys."""

    hand_out: Path | None = option(
        None,
        "take keys out of both stores as they come, into files of this new folder",
        metavar="DIR",
        recorded=False,
    )


@dataclass(frozen=True, kw_only=True)
class SwapOptions:
    """How switches that swap take turns."""

    schedule: str | None = option(
        None,
        f"order of the swaps ({PARALLEL}, or as --policy says; docs/swapping.md)",
        choices=SCHEDULES,
    )
    purify: int | None = option(
        None,
        "rounds of purification of pairs before each swap (0)",
        metavar="ROUNDS",
        range=(0, MAX_LEVEL_ROUNDS),
    )


@dataclass(frozen=True, kw_only=True)
class ServiceRequest(SenderOptions, BlockOptions, EavesdropperOptions, HandOutOptions, SwapOptions):
    """A request of a service, and its network."""

    service: str
    # Not asked for: what hosts are to find out, by their devices; None: nothing.
    phases_rad: tuple[float, ...] | None = field(default=None, metadata=recorded_as("phases_rad"))
    options: ServiceOptions  # of its session, with the host that is asked
    network: NetworkOptions
    run: RunOptions

    @property
    def receiver(self) -> str:
        return self.options.host

    @property
    def others(self) -> tuple[str, ...]:
        return tuple(self.options.names[2:])


def parts_of(verb: Verb) -> list[type[Any]]:
    """Return the classes of options, beside those of its session, that a verb has."""
    has = {
        SenderOptions: not verb.line,
        BlockOptions: True,
        EavesdropperOptions: verb.eavesdropper,
        HandOutOptions: bool(verb.hand_out),
        SwapOptions: verb.scheduled,
    }
    return [part for part, is_there in has.items() if is_there]


def has_option(verb: Verb, name: str) -> bool:
    return any(each.name == name for part in parts_of(verb) for each in fields(part))


def ends_of_line(service: str, line: str) -> dict[str, str]:
    """Return who asks and who is asked, of a service whose hosts are a line; else nothing."""
    if not verb_of(service).line:
        return {}
    sender, host, *_others = f"{line},".split(",")
    return {"sender": sender, "host": host}


def service_request(
    service: str, receiver: str = "bob", topology: str = "", **keywords: Any
) -> ServiceRequest:
    """Return the request that options fill, by their names; raise BadInput for one there is not."""
    options = named()[service].options
    line = keywords.get("line", getattr(options, "line", ""))
    return from_keywords(
        ServiceRequest,
        keywords,
        {"options": options},
        service=service,
        port=SERVICE_PORT,
        topology=topology or ("" if keywords.get("map") else verb_of(service).topology),
        **{"host": receiver, **ends_of_line(service, line)},
    )
