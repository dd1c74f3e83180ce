"""The console's lines: exact bytes, and refusals of everything else."""

import pytest

from wire.controller_lines import (
    MAX_REQUEST,
    ConsoleError,
    decode_answer,
    decode_request,
    encode_error,
    encode_request,
    encode_result,
)
from wire.malformed import MalformedPacket

SET = b'{"command": "set", "device": "alice", "settings": {"rate_hz": null}}\n'


def test_golden_lines() -> None:
    assert encode_request("set", device="alice", settings={"rate_hz": None}) == SET
    assert encode_result([1, None]) == b'{"result": [1, null]}\n'
    assert encode_error("no") == b'{"error": "no"}\n'


def test_requests_and_answers_are_read_back() -> None:
    asked = {"command": "set", "device": "alice", "settings": {"rate_hz": None}}
    assert decode_request(SET) == asked
    assert decode_answer(b'{"result": null}\n') is None
    with pytest.raises(ConsoleError, match=r"^no$"):
        decode_answer(b'{"error": "no"}\n')


@pytest.mark.parametrize(
    "line", [b"\n", b"{\n", b"\xff\n", b"[" * 4000 + b"\n", b" " * MAX_REQUEST + b"\n"]
)
def test_what_is_not_one_line_of_json_is_refused(line: bytes) -> None:
    with pytest.raises(MalformedPacket):
        decode_request(line)


@pytest.mark.parametrize("line", [b"", b"{}\n", b"[]\n", b'{"error": 5}\n', b"[" * 100_000, b"x\n"])
def test_an_answer_of_another_shape_is_refused(line: bytes) -> None:
    with pytest.raises(MalformedPacket):
        decode_answer(line)
