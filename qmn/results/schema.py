"""The schema of result.json: what its fields are, and the JSON Schema that says so to programs.

python -m qmn.results.schema > docs/result.schema.json

A run of `qmn run` leaves a RunResult; a network of `qmn cli` or of a script, on which more than one
thing is done, a NetworkResult. Times and rates are those of the network if nothing else is said.
"""

import json
import sys
from types import NoneType, UnionType
from typing import Any, Required, TypedDict, get_args, get_origin, get_type_hints

Schema = dict[str, Any]
DIALECT = "https://json-schema.org/draft/2020-12/schema"


class SetUpTimes(TypedDict):
    """From metadata at the controller to an open light path, in ms; None: there was none."""

    p50: float | None
    p99: float | None
    n: int


class WatchedLight(TypedDict):
    """Seals that are over, on light that nobody used or that programs had watched."""

    seals: int
    given_back: int  # of these, to sessions
    compared: int  # pairs
    errors: int  # of these, pairs that differed
    alarms: int
    closed: list[str]  # the fibres between switches that were closed for them


class Approximated(TypedDict):
    """An approximation that was in what was reported."""

    name: str
    most: float | None  # that the probability of an outcome can be wrong by it; None: not known


class NetworkResult(TypedDict, total=False):
    """What every network leaves."""

    topology: Required[str | None]  # None: a script's own
    mode: Required[str]  # native or docker
    controller: Required[str]
    seed: Required[int]
    parameters: Required[dict[str, Any]]  # as the command line has them
    captures: Required[list[str]]  # files
    timeline: Required[str]  # file, or why there is none
    error: str  # that ended it
    time_scale: float  # seconds here for one of the network
    time_scale_because: str | None
    network: dict[str, Any]  # qmn.results.network_facts.NetworkFacts; absent: it did not start
    metrics: dict[str, str]  # program to URL
    gnmi: dict[str, str]  # quantum switch to address
    machines: dict[str, Any]  # others than m1: address, hosts, and how far the clock is ahead
    acausal: dict[str, Any] | None  # news that can outrun light: from, to, early_s
    software_share: float | None  # of the wait in memory of which it was the largest part
    software_s: float | None
    software_share_of_run: float
    dominated_by_software: bool
    shortest_time: dict[str, Any] | None  # of the network: name, s
    software_of_shortest: float | None  # software_s as a share of it
    time_scale_kept: bool | None  # that is less than `auto` means; None: nothing waited, or no auto
    packets_not_captured: int
    files_ended: list[str]  # captures, and the record, that became too long (--file-gib)


class RunResult(NetworkResult, total=False):
    """What `qmn run` leaves; a message's counts, or what both ends of a service have said."""

    service: Required[str]
    delivered: Required[bool]  # every byte is right, or the service was done
    optics: Required[dict[str, Any]]  # of every fibre
    devices: Required[dict[str, Any]]  # what is not ideal in those of hosts
    events: Required[bool]  # whether what happened to qubits was written
    backend: Required[str]
    exact: Required[bool | None]  # None: the network did not come to say it
    approximations: list[Approximated]  # why it is not exact; absent where that is not known
    emulation: Required[dict[str, float]]  # elapsed_s and rates by the wall clock
    path_setup_ms: Required[SetUpTimes]
    packet_in_count: Required[int]
    watched: WatchedLight  # absent: no light was
    eve: dict[str, Any]  # what she saw
    # Of a service that carries bytes
    handshake: str
    file: str
    message_bytes: int
    sha256_sent: str | None
    sha256_received: str | None
    bell_pairs: int
    lost_pairs: int
    repeated_frames: int
    symbol_errors: int
    corrected_symbols: int  # by the code
    filled_symbols: int  # lost, and filled in by the code
    symbol_error_rate: float | None  # before any code or repetition; None: none was received
    in_use: dict[str, Any] | None  # what the session used, as the controller may have overridden it
    code_rate: float | None
    bell_states: int | None  # that the receiver's analyser tells apart
    confusion: list[list[int]] | None  # symbols sent (row) as they were received (column)
    elapsed_s: float
    pairs_per_s: float
    # Of every other: the last words of the host that asks, and of the one that is asked
    asking: dict[str, Any]
    asked: dict[str, Any]
    load: dict[str, Any]  # of `qmn run load`: a summary, every session, the use of every fibre
    # Of a NetQASM application
    roles: dict[str, str]  # host of each
    outputs: list[dict[str, Any]]  # what the program of each role has returned, round by round
    # Of runs that keep keys: what happened to keys and tunnels, and when (at, in s since the start)
    moments: list[dict[str, Any]]


class RunFacts(RunResult, total=False):
    """A result while its run goes on, with what is told of it and not kept."""

    report: str  # file, or how to make it


PLAIN = {str: "string", bool: "boolean", int: "integer", float: "number", NoneType: "null"}


def json_schema() -> Schema:
    """Return the JSON Schema of result.json."""
    kinds = {kind.__name__: schema_of(kind) for kind in (RunResult, NetworkResult)}
    one_of = [{"$ref": f"#/$defs/{name}"} for name in kinds]
    return {"$schema": DIALECT, "title": "result.json", "oneOf": one_of, "$defs": kinds}


def schema_of(kind: Any) -> Schema:
    """Return the JSON Schema of a type as it is written above."""
    if kind is Any:
        return {}
    if kind in PLAIN:
        return {"type": PLAIN[kind]}
    if isinstance(kind, UnionType):
        return {"anyOf": [schema_of(each) for each in get_args(kind)]}
    if get_origin(kind) is list:
        return {"type": "array", "items": schema_of(*get_args(kind))}
    if get_origin(kind) is dict:
        return {"type": "object", "additionalProperties": schema_of(get_args(kind)[1])}
    return {
        "type": "object",
        "description": " ".join((kind.__doc__ or "").split()),
        "properties": {name: schema_of(each) for name, each in get_type_hints(kind).items()},
        "required": sorted(kind.__required_keys__),
        "additionalProperties": False,
    }


def text() -> str:
    """Return the schema as its file has it."""
    return json.dumps(json_schema(), indent=2) + "\n"


if __name__ == "__main__":
    sys.stdout.write(text())
