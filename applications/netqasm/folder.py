"""The files of a NetQASM application's folder: values by name, programs, a simulator's network."""

import ast
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from qmn.options import BadInput
from wire.parameters.checks import remedy

GIVEN_ALWAYS = "app_config"
IDEAL = "NoNoise"


def read_yaml(file: Path) -> dict[str, Any]:
    """Return the values of a file by name; none if there is no file."""
    try:
        fields = yaml.safe_load(file.read_text()) if file.exists() else None
    except (yaml.YAMLError, OSError, ValueError, RecursionError) as error:
        raise BadInput(f"cannot read {file}: {error}") from error
    if fields is not None and not isinstance(fields, dict):
        raise BadInput(f"cannot read {file}: write NAME: VALUE in each line")
    return fields or {}


def check_inputs(program: Path, role: str, inputs: Mapping[str, Any]) -> None:
    """Raise BadInput if the main of a program, as far as it can be read, takes other inputs."""
    arguments = _arguments_of_main(program)
    if arguments is None:
        return
    positional = [*arguments.posonlyargs, *arguments.args]
    names = [each.arg for each in (*positional, *arguments.kwonlyargs)]
    accepted = [name for name in names if name != GIVEN_ALWAYS]
    for name in inputs:
        if name == GIVEN_ALWAYS or (name not in names and arguments.kwarg is None):
            advice = remedy(name, accepted) if accepted else "it takes no input"
            text = f"input {role}.{name}: main of {program.name} has no such parameter"
            raise BadInput(f"{text}: {advice} (--input or {role}.yaml)")
    required = [each.arg for each in positional[: len(positional) - len(arguments.defaults)]]
    named = zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
    required += [each.arg for each, default in named if default is None]
    for name in required:
        if name not in (*inputs, GIVEN_ALWAYS):
            text = f"main of {program.name} needs {name}"
            raise BadInput(f"{text}: give --input {role}.{name}=VALUE")


def left_out(file: Path) -> list[str]:
    """Return the noise of a simulator's network.yaml, none of which our network has."""
    fields = read_yaml(file)
    links, nodes = fields.get("links") or (), fields.get("nodes") or ()
    try:
        noise = [
            f"fidelity {link['fidelity']:g} ({link['noise_type']}) of {link['name']}"
            for link in links
            if link["fidelity"] != 1 and link["noise_type"] != IDEAL
        ]
        for node in nodes:
            if node["gate_fidelity"] != 1:
                noise.append(f"gate_fidelity {node['gate_fidelity']:g} of {node['name']}")
            if any(qubit["t1"] or qubit["t2"] for qubit in node["qubits"]):
                noise.append(f"t1 and t2 of {node['name']}")
    except (KeyError, TypeError, ValueError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise BadInput(f"{file} is not a network of `netqasm simulate`: {reason}") from error
    return noise


def _arguments_of_main(program: Path) -> ast.arguments | None:
    """Return the arguments of a program's own, undecorated main; None if it has none."""
    try:
        tree = ast.parse(program.read_bytes(), str(program))
    except (OSError, SyntaxError, ValueError) as error:
        raise BadInput(f"cannot read {program}: {error}") from error
    mains = [
        each for each in tree.body if isinstance(each, ast.FunctionDef) and each.name == "main"
    ]
    return mains[-1].args if mains and not mains[-1].decorator_list else None
