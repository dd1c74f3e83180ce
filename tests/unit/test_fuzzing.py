"""A few of the inputs of `make fuzz`, and whether it would notice."""

import importlib
import pkgutil
import sys
from collections.abc import Iterator
from random import Random
from types import CodeType, FrameType, FunctionType, ModuleType

import pytest
from decoders import EXCUSED, TARGETS
from feed import SERVERS, Piece, pieces, run
from requests_to_dispatcher import Dispatcher
from requests_to_sabot import SabotServer
from target import Fault, Target

import wire
from dispatcher.layer.ownership import Ownership
from dispatcher.refusal import invalid
from wire.malformed import MalformedPacket

INPUTS = 400  # of each decoder
FORMATS = [  # outside wire/
    *("applications.ip_over_light.ip_packet", "applications.keys.key_assignment"),
    *("applications.keys.key_delivery", "applications.keys.key_relay"),
    *("applications.netqasm.text_format", "applications.processing_unit.messages"),
    *("applications.processing_unit.pair_requests", "applications.processing_unit.subroutine"),
]


@pytest.mark.parametrize("name", TARGETS)
def test_spoiled_messages_are_refused_or_mean_what_they_say(name: str) -> None:
    result = run(Piece(name, 7, INPUTS))
    assert (result.inputs, result.fault) == (INPUTS, "")


def test_every_decoder_of_a_format_is_fed_or_excused_with_a_reason() -> None:
    decoders = {name: code for module in modules_of_formats() for name, code in decoders_of(module)}
    assert len(decoders) > 40
    reached = run_by_samples()
    assert {name for name, code in decoders.items() if code not in reached} == set(EXCUSED)
    assert all(EXCUSED.values())


def modules_of_formats() -> Iterator[ModuleType]:
    in_wire = [found.name for found in pkgutil.walk_packages(wire.__path__, "wire.")]
    for name in (*in_wire, *FORMATS):
        if "_pb2" not in name:
            yield importlib.import_module(name)


def decoders_of(module: ModuleType) -> Iterator[tuple[str, CodeType]]:
    """Yield the public functions and methods of a module that decode or parse, with their code."""
    classes = [each for each in vars(module).values() if isinstance(each, type)]
    for holder in (module, *classes):
        for name, member in vars(holder).items():
            function = getattr(member, "__func__", member)
            ours = isinstance(function, FunctionType) and function.__module__ == module.__name__
            if ours and name.startswith(("decode", "parse")):
                yield f"{module.__name__}.{function.__qualname__}", function.__code__


def run_by_samples() -> set[CodeType]:
    """Return the code of all that runs while each target decodes what is right."""
    reached: set[CodeType] = set()

    def note(frame: FrameType, event: str, _value: object) -> None:
        if event == "call":
            reached.add(frame.f_code)

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        for target in TARGETS.values():
            for sample in target.samples:
                target.take(sample)
    finally:
        sys.setprofile(before)
    return reached


def test_spoiled_requests_change_nothing_of_others() -> None:
    done, fault = Dispatcher(Random(7)).feed(500)
    assert fault == ""
    assert 50 < done < 450


def test_spoiled_requests_to_sabot_change_no_other_workspace_and_refused_ones_nothing() -> None:
    done, fault = SabotServer(Random(7)).feed(500)
    assert fault == ""
    assert 50 < done < 450


def test_every_input_is_fed_once() -> None:
    work = pieces(1_000_000, 1, [*TARGETS, *SERVERS])
    assert len(set(work)) == len(work)
    assert 999_000 < sum(piece.inputs for piece in work) <= 1_000_000


def broken(data: bytes) -> bytes:
    """A decoder that falls over what is not UTF-8, and does not see the last byte."""
    if not data:
        raise MalformedPacket("nothing")
    data.decode()
    return data[:-1]


def test_a_foreign_error_is_a_fault() -> None:
    target = Target([b"message"], broken)
    with pytest.raises(UnicodeDecodeError):
        target.take(b"\xff")
    assert not target.take(b"")


def test_what_is_read_as_another_is_a_fault() -> None:
    with pytest.raises(Fault, match="which is written"):
        Target([b"a"], broken, lambda value: value).take(b"ab")
    with pytest.raises(Fault, match="as another"):
        Target([b"a"], broken, lambda value: value, canonical=False).take(b"ab")


def test_a_refusal_that_has_changed_something_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    add = Ownership.add

    def add_and_refuse(self: Ownership, block: object) -> None:
        add(self, block)  # type: ignore[arg-type]
        if self.count > 8:  # more than the scene begins with
            raise invalid("too late")

    monkeypatch.setattr(Ownership, "add", add_and_refuse)
    _done, fault = Dispatcher(Random(7)).feed(500)
    assert "a refusal has changed" in fault
