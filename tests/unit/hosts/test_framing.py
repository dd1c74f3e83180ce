"""Outbox and inbox back to back, with a noisy line between them."""

from collections.abc import Callable

import numpy as np
import pytest

from hosts.hardware.qnic import Symbols
from hosts.middleware.framing import FramingError, Inbox, Outbox, OutgoingBlock
from wire.metadata import Block, Frame, Report, decode

Line = Callable[[Symbols], Symbols]


def announce(block: OutgoingBlock) -> Block:
    message = Block(1, block.number, block.symbols.size, block.refills, 0, block.frames)
    received = decode(message.encode())
    assert isinstance(received, Block)
    return received


def transmit(outbox: Outbox, inbox: Inbox, line: Line, limit: int = 1000) -> bytes:
    """Send until the outbox is empty; return what the inbox gives out."""
    received = b""
    for _ in range(limit):
        if outbox.empty:
            return received
        block = outbox.next_block()
        report = decode(inbox.block(announce(block), line(block.symbols.copy())).encode())
        assert isinstance(report, Report)
        outbox.report(block, report)
        received += inbox.take()
    raise AssertionError(f"not delivered in {limit} blocks")


def noisy_line(seed: int, loss: float = 0.0, errors: float = 0.0) -> Line:
    generator = np.random.default_rng(seed)

    def line(symbols: Symbols) -> Symbols:
        wrong = generator.random(symbols.size) < errors
        symbols[wrong] ^= generator.integers(1, 4, wrong.sum(), dtype=np.uint8)
        symbols[generator.random(symbols.size) < loss] = 255
        return symbols

    return line


@pytest.mark.parametrize("size", [0, 1, 15, 16, 17, 1000])
@pytest.mark.parametrize("seed", range(4))
def test_what_arrives_is_exactly_what_was_sent(size: int, seed: int) -> None:
    data = np.random.default_rng(seed).bytes(size)
    outbox, inbox = Outbox(16, 200), Inbox(16)
    outbox.add(data)
    assert transmit(outbox, inbox, noisy_line(seed, loss=0.2, errors=0.01)) == data
    assert inbox.take() == b""


def test_only_lost_pairs_are_sent_again() -> None:
    outbox, inbox = Outbox(16, 64), Inbox(16)
    outbox.add(bytes(16))
    block = outbox.next_block()
    symbols = block.symbols.copy()
    symbols[[3, 60]] = 255
    outbox.report(block, inbox.block(announce(block), symbols))
    again = outbox.next_block()
    assert (again.refills, again.frames, again.symbols.size) == (2, (), 2)


def test_a_frame_that_fails_its_check_is_sent_again_and_its_errors_are_counted() -> None:
    outbox, inbox = Outbox(4, 32), Inbox(4)
    outbox.add(b"abcdefgh")
    block = outbox.next_block()
    symbols = block.symbols.copy()
    symbols[17] ^= 1  # in the second frame
    symbols[18] ^= 2
    report = inbox.block(announce(block), symbols)
    assert report.failed == (1,)
    assert inbox.take() == b"abcd"
    outbox.report(block, report)
    assert outbox.attempts == {1: 1}
    assert transmit(outbox, inbox, lambda symbols: symbols) == b"efgh"
    assert (inbox.symbol_errors, inbox.repeated_frames, outbox.repeated_frames) == (2, 1, 1)
    assert outbox.attempts == {}


def test_bytes_come_out_in_order_though_an_early_frame_comes_late() -> None:
    outbox, inbox = Outbox(4, 16), Inbox(4)
    outbox.add(b"abcdefgh")
    block = outbox.next_block()
    lost = np.full(16, 255, dtype=np.uint8)
    outbox.report(block, inbox.block(announce(block), lost))
    assert inbox.take() == b""
    assert transmit(outbox, inbox, lambda symbols: symbols) == b"abcdefgh"


def test_a_dark_block_is_sent_again_under_a_new_number() -> None:
    outbox, inbox = Outbox(4, 16), Inbox(4)
    outbox.add(b"abcdefgh")
    first = outbox.next_block()
    outbox.dark(first)
    second = outbox.next_block()
    assert second.number == first.number + 1
    assert second.frames == first.frames
    outbox.report(second, inbox.block(announce(second), second.symbols))
    assert inbox.take() + transmit(outbox, inbox, lambda symbols: symbols) == b"abcdefgh"


def test_a_block_without_pairs_changes_nothing() -> None:
    inbox = Inbox(4)
    report = inbox.block(Block(1, 1, 0, 0, 0), np.empty(0, dtype=np.uint8))
    assert (report.pairs, report.failed, report.lost) == (0, (), b"")
    assert inbox.take() == b""


def test_new_frames_come_only_when_all_that_is_open_is_sent_again() -> None:
    inbox = Inbox(4)
    first = Block(1, 1, 16, 0, 0, (Frame(0, 4, 0),))
    inbox.block(first, np.full(16, 255, dtype=np.uint8))
    with pytest.raises(FramingError, match="before the open ones"):
        inbox.block(Block(1, 2, 16, 0, 0, (Frame(1, 4, 0),)), np.zeros(16, dtype=np.uint8))


@pytest.mark.parametrize(("frame_bytes", "block_pairs"), [(1, 262_144), (4, 262_144)])
def test_many_small_frames_fit_into_messages(frame_bytes: int, block_pairs: int) -> None:
    outbox, inbox = Outbox(frame_bytes, block_pairs), Inbox(frame_bytes)
    data = bytes(range(256)) * 80
    outbox.add(data)
    assert transmit(outbox, inbox, lambda symbols: symbols) == data


def test_nothing_of_a_delivered_message_is_kept() -> None:
    outbox, inbox = Outbox(16, 128), Inbox(16)
    outbox.add(bytes(4096))
    transmit(outbox, inbox, noisy_line(3, loss=0.3))
    assert not outbox._symbols
    assert not inbox._frames


@pytest.mark.parametrize(
    ("frames", "refills", "words"),
    [
        ((Frame(1, 4, 0),), 0, "out of order"),
        ((Frame(0, 5, 0),), 0, "has 5 bytes"),
        ((), 3, "refills more than is open"),
    ],
)
def test_an_impossible_block_changes_nothing(
    frames: tuple[Frame, ...], refills: int, words: str
) -> None:
    inbox = Inbox(4)
    pairs = refills + 4 * sum(frame.size for frame in frames)
    with pytest.raises(FramingError, match=words):
        inbox.block(Block(1, 1, pairs, refills, 0, frames), np.zeros(pairs, dtype=np.uint8))
    assert inbox.symbols_seen == 0
    assert not inbox._frames


@pytest.mark.parametrize(
    "report", [Report(1, 2, 16, 0), Report(1, 1, 15, 0), Report(1, 1, 16, 0, (5,))]
)
def test_an_impossible_report_is_refused(report: Report) -> None:
    outbox = Outbox(4, 16)
    outbox.add(b"abcd")
    with pytest.raises(FramingError):
        outbox.report(outbox.next_block(), report)
