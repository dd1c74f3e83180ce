"""Outcomes of NetQASM programs in what they send and return: X|0> is measured as 1, always."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from netqasm.sdk import Qubit
from netqasm.sdk.classical_communication.message import StructuredMessage
from netqasm.sdk.futures import NoValueError
from netqasm_scene import outputs

from applications.netqasm.outcomes import plain, resolved


@dataclass
class Found:
    """An output with a name for its outcome."""

    outcome: Any


NESTED: list[tuple[Callable[[Any], Any], Any]] = [
    (lambda m: m, 1),
    (lambda m: [m, (0, m)], [1, [0, 1]]),
    (lambda m: {"a": {"b": [m]}}, {"a": {"b": [1]}}),
    (lambda m: {m: "name"}, {"1": "name"}),
    (lambda m: {m}, [1]),
    (Found, {"outcome": 1}),
    (lambda m: {"a": [Found((m,))]}, {"a": [{"outcome": [1]}]}),
]


def one(unit: Any, **words: Any) -> Any:
    """Return the outcome 1, as soon as the connection is flushed."""
    qubit = Qubit(unit)
    qubit.X()
    return qubit.measure(**words)


def test_every_outcome_is_sent_and_returned_as_it_was_measured(tmp_path: Path) -> None:
    def alice(app_config: Any) -> list[Any]:
        from netqasm.sdk.external import NetQASMConnection, Socket

        texts = Socket("alice", "bob")
        with NetQASMConnection("alice") as unit:
            outcome = one(unit)
            unit.flush()
            for nest, _ in NESTED:
                texts.send_structured(StructuredMessage("m", nest(outcome)))
            of_register = one(unit, store_array=False)
        objects = np.array([outcome, [0, outcome]], dtype=object)
        return [*(nest(outcome) for nest, _ in NESTED), of_register, objects, 1j, Path("a")]

    def bob(app_config: Any) -> list[Any]:
        from netqasm.sdk.external import Socket

        texts = Socket("bob", "alice")
        return [texts.recv_structured().payload for _ in NESTED]

    (found,) = outputs(tmp_path, {"alice": alice, "bob": bob}, {"alice": "alice", "bob": "bob"})
    expected = [right for _, right in NESTED]
    assert found["bob"] == expected
    assert plain(found["alice"]) == [*expected, 1, [1, [0, 1]], [0, 1], "a"]


def test_an_outcome_that_is_not_known_yet_is_not_sent_as_a_number(tmp_path: Path) -> None:
    def alice(app_config: Any) -> None:
        from netqasm.sdk.external import NetQASMConnection

        with NetQASMConnection("alice") as unit:
            outcome = one(unit)
            with pytest.raises(NoValueError, match="flus"):
                resolved({"m": [outcome]})

    outputs(tmp_path, {"alice": alice}, {"alice": "alice"})


def test_an_outcome_of_a_branch_that_was_not_taken_is_returned_as_none(tmp_path: Path) -> None:
    def alice(app_config: Any) -> dict[str, Any]:
        from netqasm.sdk.external import NetQASMConnection

        with NetQASMConnection("alice") as unit:
            taken, other = one(unit), Qubit(unit)
            with taken.if_eq(0):
                skipped = other.measure()
        return {"taken": taken, "skipped": [skipped]}

    (found,) = outputs(tmp_path, {"alice": alice}, {"alice": "alice"})
    assert plain(found["alice"]) == {"taken": 1, "skipped": [None]}
