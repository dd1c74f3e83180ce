"""The JSON of result.json: its schema, as programs read it, and how a result is read back.

python -m qmn.results.schema > docs/result.schema.json

Both follow from the dataclasses of qmn.results.run_result and qmn.requests.
"""

import json
import sys
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args

from qmn.network.options import NetworkOptions
from qmn.requests.recording import read_fields, recorded_fields
from qmn.requests.run_options import RunOptions
from qmn.results.run_result import ABSENT, BESIDE, NetworkResult, RunResult
from wire import typed_json
from wire.malformed import MalformedPacket
from wire.parameters.checks import remedy
from wire.parameters.option import declared
from wire.results import schema
from wire.results.run_result import RESULT
from wire.results.schema import Schema

# Services and fields of earlier results.
RENAMED = {"switch_swap": "swap"}
FIELDS = {"given_back": "preempted", "moments": "time_series", "seals": "monitors"}
FIELDS["looking"] = "state_inspection"
COMMON, OF_JOB = "parameters of every job", "parameters of "
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def json_schema() -> Schema:
    definitions: Schema = {}
    one_of = []
    for kind, parameters in (
        (RunResult, _requests(definitions)),
        (NetworkResult, _network(definitions)),
    ):
        one_of.append(schema.schema_of(kind, definitions, {"parameters": parameters}))
    return {"$schema": DIALECT, "title": "result.json", "oneOf": one_of, "$defs": definitions}


def _requests(definitions: Schema) -> Schema:
    """Return the schema of what runs keep of requests; each one is added to `definitions`.

    Of every job there are the parameters of the network, and those that are its own.
    """
    from qmn.requests.kinds import RECORDED_REQUESTS  # requests take a moment to load

    common = {**recorded_fields(NetworkOptions), **recorded_fields(RunOptions)}
    definitions[COMMON] = _object(common, NetworkOptions, definitions, (None,))
    for name, entry in RECORDED_REQUESTS.items():
        fields_ = {name: each for name, each in entry.fields.items() if name not in common}
        definitions[OF_JOB + name] = {
            **_object(fields_, entry.kind, definitions, (None,)),
            "allOf": [{"$ref": f"#/$defs/{COMMON}"}],
            "unevaluatedProperties": False,
        }
    return {"anyOf": [{"$ref": f"#/$defs/{OF_JOB}{name}"} for name in RECORDED_REQUESTS]}


def _network(definitions: Schema) -> Schema:
    options = {field.name: field for field in fields(NetworkOptions) if field.name not in BESIDE}
    return {**_object(options, NetworkOptions, definitions, ABSENT), "additionalProperties": False}


def _object(
    fields_: Mapping[str, Any], kind: type[Any], definitions: Schema, absent: tuple[object, ...]
) -> Schema:
    """Return the schema of fields by name, without values that are absent."""
    always = (name for name, each in fields_.items() if each.default not in absent)
    return {
        "type": "object",
        "description": " ".join((kind.__doc__ or "").split()),
        "properties": {
            name: schema.schema_of(_there(f.type), definitions) for name, f in fields_.items()
        },
        "required": sorted(name for name in always if "of" not in declared(fields_[name])),
    }


def _there(kind: Any) -> Any:
    """Return the type of a value that is present: None is not kept."""
    if isinstance(kind, UnionType):
        kinds = [option for option in get_args(kind) if option is not NoneType]
        return kinds[0] if len(kinds) == 1 else kind
    return kind


def read_left(folder: Path) -> NetworkResult:
    """Return what a network has left in its folder; raise OSError or MalformedPacket."""
    return of_either_kind(schema.decoded(folder / RESULT))


def of_either_kind(content: Any) -> NetworkResult:
    """Return the result of a run or of a network; raise MalformedPacket for anything else."""
    content, head = _renamed(content), schema.head_of(content)
    if missing := [name for name in (*BESIDE, "parameters") if name not in content]:
        raise MalformedPacket(f"the result has no {', '.join(missing)}")
    return read_run(content) if head.service is not None else _read_network(content)


def read_run(content: dict[str, Any]) -> RunResult:
    """Return the result of a run as decoded JSON says it; raise MalformedPacket for others."""
    from qmn.requests.kinds import RECORDED_REQUESTS, job_of

    content = _renamed({**content, "service": RENAMED.get(content["service"], content["service"])})
    head, fields_read = (
        schema.head_of(content),
        {name: content.get(name) for name in (*BESIDE, "backend")},
    )
    entry = RECORDED_REQUESTS.get(job_of(head.service or "", head.job))
    if entry is None:
        service = head.service or ""
        raise MalformedPacket(f"unknown service {service!r}: {remedy(service, RECORDED_REQUESTS)}")
    parameters = entry.read(head.parameters, **fields_read)
    return typed_json.read(RunResult, {**content, "parameters": parameters})


def _renamed(value: Any, depth: int = 1) -> Any:
    """Return fields of a result, and of its parts, by the names of today."""
    if not isinstance(value, dict):
        return value
    return {
        FIELDS.get(name, name): _renamed(part, depth - 1) if depth > 0 or name == "asking" else part
        for name, part in value.items()
    }


def _read_network(content: dict[str, Any]) -> NetworkResult:
    fields_ = {field.name: field for field in fields(NetworkOptions) if field.name not in BESIDE}
    beside = {name: content[name] for name in BESIDE if content[name] is not None}
    options = NetworkOptions(**read_fields(fields_, content["parameters"]), **beside)
    return typed_json.read(NetworkResult, {**content, "parameters": options})


def text() -> str:
    return json.dumps(json_schema(), indent=2) + "\n"


if __name__ == "__main__":
    sys.stdout.write(text())
