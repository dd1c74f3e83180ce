"""Why a program hears nothing any more of its host's stack: because that ended, or by itself."""

import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hosts.quantum_socket import QuantumSocket, QuantumSocketError, StackEnded
from hosts.stack_socket import StackSocket
from wire.socket_calls import Call, encode_fields

Use = Callable[[QuantumSocket], object]
CALLS: list[Use] = [lambda used: used.recv(1), lambda used: used.sendall(b"x")]
WITHIN_S = 10.0


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[tuple[QuantumSocket, socket.socket]]:
    """A program's socket, and the other end, which answers nothing."""
    path = str(tmp_path / "stack")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(path)
        listener.listen()
        with QuantumSocket(path) as used, listener.accept()[0] as end:
            yield used, end


@pytest.mark.parametrize("call", CALLS, ids=["recv", "sendall"])
@pytest.mark.parametrize("waits", [True, False])
def test_a_program_that_closes_its_socket_is_not_told_that_the_stack_has_ended(
    stack: tuple[QuantumSocket, socket.socket], call: Use, waits: bool
) -> None:
    used, _end = stack
    heard: list[Exception] = []

    def calls() -> None:
        with pytest.raises(QuantumSocketError, match="this socket has been closed") as caught:
            call(used)
        heard.append(caught.value)

    thread = threading.Thread(target=calls)
    if waits:
        thread.start()
    used.close()
    if not waits:
        thread.start()
    thread.join(WITHIN_S)
    assert [type(error) for error in heard] == [QuantumSocketError]


@pytest.mark.parametrize("call", CALLS, ids=["recv", "sendall"])
def test_a_stack_that_ends_is_named(stack: tuple[QuantumSocket, socket.socket], call: Use) -> None:
    used, end = stack
    end.close()
    with pytest.raises(StackEnded, match="the host's stack has ended"):
        call(used)


@pytest.mark.parametrize("cut", range(1, 40, 3))
def test_answers_of_the_stack_that_are_cut_anywhere_are_read_each_whole(
    tmp_path: Path, cut: int
) -> None:
    answers = [{"peer": "alice"}, {"peer": "bob"}]
    data = b"".join(encode_fields(Call.DONE, **answer) for answer in answers)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "stack"))
        listener.listen()
        with StackSocket(tmp_path / "stack") as program, listener.accept()[0] as stack:
            stack.sendall(data[:cut])
            timer = threading.Timer(0.01, stack.sendall, [data[cut:]])
            timer.start()
            assert [program._done(), program._done()] == answers
            timer.join()
