"""Outbox and inbox back to back, with a noisy line between them."""

from collections import deque
from collections.abc import Callable

import numpy as np
import pytest

from hosts.hardware.replies import Symbols
from hosts.middleware.services.superdense.coding import CODES, Code
from hosts.middleware.services.superdense.frame_format import (
    ALPHABETS,
    BLOCKS_UNDER_WAY,
    Alphabet,
    FrameFormat,
    FramingError,
)
from hosts.middleware.services.superdense.inbox import Inbox
from hosts.middleware.services.superdense.outbox import Outbox, OutgoingBlock
from wire.metadata.blocks import Block, Frame, Report
from wire.metadata.decoding import decode
from wire.metadata.vocabulary import Fec

PLAIN = FrameFormat()
GOLAY = FrameFormat(CODES[Fec.GOLAY], True)

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


def noisy_line(seed: int, loss: float = 0.0, errors: float = 0.0, symbols_told: int = 4) -> Line:
    generator = np.random.default_rng(seed)

    def line(symbols: Symbols) -> Symbols:
        wrong = generator.random(symbols.size) < errors
        symbols[wrong] += generator.integers(1, symbols_told, wrong.sum(), dtype=np.uint8)
        symbols %= symbols_told
        symbols[generator.random(symbols.size) < loss] = 255
        return symbols

    return line


@pytest.mark.parametrize("size", [0, 1, 15, 16, 17, 1000])
@pytest.mark.parametrize("seed", range(4))
def test_what_arrives_is_exactly_what_was_sent(size: int, seed: int) -> None:
    data = np.random.default_rng(seed).bytes(size)
    outbox, inbox = Outbox(16, 200, PLAIN), Inbox(16, PLAIN)
    outbox.add(data)
    assert transmit(outbox, inbox, noisy_line(seed, loss=0.2, errors=0.01)) == data
    assert inbox.take() == b""


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("alphabet", ALPHABETS.values(), ids=lambda a: str(a.symbols))
@pytest.mark.parametrize("interleaved", [False, True])
@pytest.mark.parametrize("code", CODES.values(), ids=lambda code: code.name)
@pytest.mark.parametrize("block_pairs", [40, 3000])
def test_every_code_delivers_exactly_over_a_line_with_losses_and_errors(
    code: Code, interleaved: bool, alphabet: Alphabet, block_pairs: int
) -> None:
    used = FrameFormat(code, interleaved, alphabet)
    data = np.random.default_rng(5).bytes(601)
    outbox, inbox = Outbox(16, block_pairs, used), Inbox(16, used)
    outbox.add(data)
    assert transmit(outbox, inbox, noisy_line(6, 0.1, 0.003, alphabet.symbols)) == data
    assert inbox.take() == b""
    assert outbox.empty


def test_a_code_fills_what_is_lost_and_nothing_is_sent_again() -> None:
    outbox, inbox = Outbox(16, 64, GOLAY), Inbox(16, GOLAY)
    outbox.add(b"sixteen letters!")
    block = outbox.next_block()
    symbols = block.symbols.copy()
    symbols[[3, 60, 61]] = 255
    symbols[7] ^= 3
    report = inbox.block(announce(block), symbols)
    assert (report.lost, report.filled, report.corrected, report.errors) == (3, 3, 1, 1)
    assert (report.failed, report.again) == ((), b"")
    outbox.report(block, report)
    assert outbox.empty
    assert inbox.take() == b"sixteen letters!"


def test_what_a_code_cannot_fill_is_asked_for_again_before_the_whole_frame_is() -> None:
    outbox, inbox = Outbox(16, 200, GOLAY), Inbox(16, GOLAY)
    outbox.add(b"sixteen letters!")
    block = outbox.next_block()
    symbols = block.symbols.copy()
    symbols[:60] = 255
    symbols[120] ^= 1
    report = inbox.block(announce(block), symbols)
    assert (report.lost, report.failed) == (60, ())
    outbox.report(block, report)
    again = outbox.next_block()
    assert (again.refills, again.frames) == (60, ())
    outbox.report(again, inbox.block(announce(again), again.symbols))
    assert inbox.take() == b"sixteen letters!"  # with the error corrected
    assert (inbox.corrected_symbols, inbox.filled_symbols, inbox.repeated_frames) == (1, 0, 0)


def test_a_frame_is_not_tried_while_symbols_of_it_are_on_their_way() -> None:
    outbox, inbox = Outbox(16, 130, GOLAY), Inbox(16, GOLAY)
    outbox.add(b"sixteen letters!")
    block = outbox.next_block()
    outbox.report(block, inbox.block(announce(block), np.full_like(block.symbols, 255)))
    outbox._block_pairs = 120  # of 127: Golay could fill the rest
    part = outbox.next_block()
    outbox.report(part, inbox.block(announce(part), part.symbols))
    assert inbox.take() == b""
    assert outbox.next_block().refills == block.symbols.size - 120


def test_a_frame_that_a_code_cannot_correct_is_repeated_as_a_whole() -> None:
    outbox, inbox = Outbox(16, 200, GOLAY), Inbox(16, GOLAY)
    outbox.add(b"sixteen letters!")
    block = outbox.next_block()
    report = inbox.block(announce(block), block.symbols ^ np.uint8(3))
    assert report.failed == (0,)
    outbox.report(block, report)
    assert transmit(outbox, inbox, lambda symbols: symbols) == b"sixteen letters!"
    assert inbox.symbol_errors == block.symbols.size
    assert (inbox.corrected_symbols, inbox.repeated_frames) == (0, 1)


@pytest.mark.parametrize(
    ("fec", "rate"), [(Fec.NONE, 1), (Fec.HAMMING, 4 / 7), (Fec.REED_SOLOMON, 300 / (300 + 3 * 32))]
)
def test_the_rate_is_data_over_code_bits_of_all_frames(fec: Fec, rate: float) -> None:
    outbox = Outbox(256, 4096, FrameFormat(CODES[fec]))
    assert outbox.code_rate == 1
    outbox.add(bytes(300))  # a frame of 256 bytes and one of 44
    assert outbox.code_rate == pytest.approx(rate)


def test_only_lost_pairs_are_sent_again() -> None:
    outbox, inbox = Outbox(16, 64, PLAIN), Inbox(16, PLAIN)
    outbox.add(bytes(16))
    block = outbox.next_block()
    symbols = block.symbols.copy()
    symbols[[3, 60]] = 255
    outbox.report(block, inbox.block(announce(block), symbols))
    again = outbox.next_block()
    assert (again.refills, again.frames, again.symbols.size) == (2, (), 2)


def test_a_frame_that_fails_its_check_is_sent_again_and_its_errors_are_counted() -> None:
    outbox, inbox = Outbox(4, 32, PLAIN), Inbox(4, PLAIN)
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
    outbox, inbox = Outbox(4, 16, PLAIN), Inbox(4, PLAIN)
    outbox.add(b"abcdefgh")
    block = outbox.next_block()
    lost = np.full(16, 255, dtype=np.uint8)
    outbox.report(block, inbox.block(announce(block), lost))
    assert inbox.take() == b""
    assert transmit(outbox, inbox, lambda symbols: symbols) == b"abcdefgh"


def test_a_dark_block_is_sent_again_under_a_new_number() -> None:
    outbox, inbox = Outbox(4, 16, PLAIN), Inbox(4, PLAIN)
    outbox.add(b"abcdefgh")
    first = outbox.next_block()
    outbox.dark(first)
    second = outbox.next_block()
    assert second.number == first.number + 1
    assert second.frames == first.frames
    outbox.report(second, inbox.block(announce(second), second.symbols))
    assert inbox.take() + transmit(outbox, inbox, lambda symbols: symbols) == b"abcdefgh"


def test_a_block_without_pairs_changes_nothing() -> None:
    inbox = Inbox(4, PLAIN)
    report = inbox.block(Block(1, 1, 0, 0, 0), np.empty(0, dtype=np.uint8))
    assert (report.pairs, report.failed, report.again) == (0, (), b"")
    assert inbox.take() == b""


def test_new_frames_beside_refills_come_only_when_all_that_is_open_is_sent_again() -> None:
    inbox = Inbox(4, PLAIN)
    first = Block(1, 1, 16, 0, 0, (Frame(0, 4, 0),))
    inbox.block(first, np.full(16, 255, dtype=np.uint8))
    with pytest.raises(FramingError, match="before the open ones"):
        inbox.block(Block(1, 2, 31, 15, 0, (Frame(1, 4, 0),)), np.zeros(31, dtype=np.uint8))


def test_only_so_many_blocks_are_ahead_of_what_is_open() -> None:
    inbox = Inbox(4, PLAIN)
    lost = np.full(16, 255, dtype=np.uint8)
    blocks = [Block(1, n, 16, 0, 0, (Frame(n, 4, 0),)) for n in range(BLOCKS_UNDER_WAY + 1)]
    for block in blocks[:-1]:
        assert inbox.block(block, lost).lost == 16
    with pytest.raises(FramingError, match="block 4 begins new frames before the open ones"):
        inbox.block(blocks[-1], lost)
    # All that is open comes again in one block, and new frames behind it.
    again = Block(1, 9, 64 + 16, 64, 0, (Frame(BLOCKS_UNDER_WAY, 4, 0),))
    inbox.block(again, np.zeros(80, dtype=np.uint8))


@pytest.mark.parametrize("used", [PLAIN, GOLAY])
@pytest.mark.parametrize(("loss", "errors"), [(0.0, 0.0), (0.1, 0.01), (0.7, 0.0)])
def test_blocks_that_go_ahead_deliver_exactly(
    used: FrameFormat, loss: float, errors: float
) -> None:
    data = np.random.default_rng(12).bytes(3_000)
    outbox, inbox, line = Outbox(16, 1_000, used), Inbox(16, used), noisy_line(13, loss, errors)
    outbox.add(data)
    under_way: deque[tuple[OutgoingBlock, Report]] = deque()
    received, most = b"", 0
    for _ in range(1_000):
        if (outbox.goes_ahead and len(under_way) < BLOCKS_UNDER_WAY) or not under_way:
            if outbox.empty:
                break
            block = outbox.next_block()
            under_way.append((block, inbox.block(announce(block), line(block.symbols.copy()))))
            most = max(most, len(under_way))
            received += inbox.take()
        else:
            outbox.report(*under_way.popleft())
    assert received == data
    assert most == BLOCKS_UNDER_WAY


@pytest.mark.parametrize(("frame_bytes", "block_pairs"), [(1, 262_144), (4, 262_144)])
def test_many_small_frames_fit_into_messages(frame_bytes: int, block_pairs: int) -> None:
    outbox, inbox = Outbox(frame_bytes, block_pairs, PLAIN), Inbox(frame_bytes, PLAIN)
    data = bytes(range(256)) * 80
    outbox.add(data)
    assert transmit(outbox, inbox, lambda symbols: symbols) == data


@pytest.mark.parametrize("used", [PLAIN, GOLAY])
def test_nothing_of_a_delivered_message_is_kept(used: FrameFormat) -> None:
    outbox, inbox = Outbox(16, 128, used), Inbox(16, used)
    outbox.add(bytes(4096))
    transmit(outbox, inbox, noisy_line(3, loss=0.3))
    assert not outbox._frames
    assert not inbox._frames


@pytest.mark.parametrize(
    ("frames", "refills", "words"),
    [
        ((Frame(1, 4, 0),), 0, "out of order"),
        ((Frame(0, 5, 0),), 0, "has 5 bytes"),
        ((), 3, "refills more than is open"),
        ((Frame(0, 3, 0),), 0, "16 pairs do not carry 0 refills and frames of 12 pairs"),
    ],
)
def test_an_impossible_block_changes_nothing(
    frames: tuple[Frame, ...], refills: int, words: str
) -> None:
    inbox = Inbox(4, PLAIN)
    pairs = refills + (16 if frames else 0)
    with pytest.raises(FramingError, match=words):
        inbox.block(Block(1, 1, pairs, refills, 0, frames), np.zeros(pairs, dtype=np.uint8))
    assert inbox.symbols_seen == 0
    assert not inbox._frames


@pytest.mark.parametrize(
    "report",
    [
        Report(1, 2, 16),
        Report(1, 1, 15),
        Report(1, 1, 16, failed=(5,)),
        Report(1, 1, 16, failed=(0, 0)),
    ],
)
def test_an_impossible_report_is_refused(report: Report) -> None:
    outbox = Outbox(4, 16, PLAIN)
    outbox.add(b"abcd")
    with pytest.raises(FramingError):
        outbox.report(outbox.next_block(), report)


def test_what_was_sent_and_what_was_received_are_counted_by_symbol() -> None:
    plain_out, plain_in = Outbox(16, 64, PLAIN), Inbox(16, PLAIN)
    plain_out.add(bytes([0b00_01_10_11] * 32))  # two frames, of which the first is spoiled
    spoiled = [True]

    def line(symbols: Symbols) -> Symbols:
        if spoiled:
            spoiled.pop()
            symbols[:3] = [3, 255, 2]  # 0 came as 3, 1 not at all
        return symbols

    transmit(plain_out, plain_in, line)
    # Its 63 pairs, the lost one again, and all again because the check was wrong.
    counts = np.diag([48, 48, 48, 48])
    counts[0, 0], counts[0, 3] = 47, 1
    assert plain_in.confusion.tolist() == counts.tolist()


def test_a_code_tells_what_was_sent_in_place_of_wrong_symbols() -> None:
    outbox, inbox = Outbox(16, 1000, GOLAY), Inbox(16, GOLAY)
    outbox.add(b"sixteen letters!")
    block = outbox.next_block()
    received = block.symbols.copy()
    received[0], received[1] = received[0] ^ 3, 255
    outbox.report(block, inbox.block(announce(block), received))
    assert (inbox.corrected_symbols, inbox.filled_symbols) == (1, 1)
    counts = np.zeros((4, 4), dtype=int)
    np.add.at(counts, (block.symbols, received & 3), 1)
    counts[block.symbols[1], 3] -= 1  # lost: it was received as nothing
    assert inbox.confusion.tolist() == counts.tolist()


def test_where_little_light_arrives_few_blocks_are_enough() -> None:
    data, arriving = np.random.default_rng(8).bytes(2_000), 0.06
    outbox, inbox = Outbox(256, 200_000, PLAIN), Inbox(256, PLAIN)
    outbox.add(data)
    # A symbol that 1/T pairs carry is lost with (1 - T)^(1/T) < 1/e, so each round leaves less than
    # that; as many again for chance, and for the rounds that few symbols take.
    rounds = 2 * np.log(4 * len(data))
    assert transmit(outbox, inbox, noisy_line(9, 1 - arriving), limit=int(rounds)) == data


@pytest.mark.parametrize(
    ("loss", "errors", "frame_bytes"), [(0.9, 0.01, 4), (0.0, 0.05, 16)], ids=["copies", "versions"]
)
def test_all_that_arrives_counts_among_the_right_and_wrong_symbols(
    loss: float, errors: float, frame_bytes: int
) -> None:
    data, noisy = np.random.default_rng(10).bytes(600), noisy_line(11, loss, errors)
    outbox, inbox = Outbox(frame_bytes, 20_000, PLAIN), Inbox(frame_bytes, PLAIN)
    outbox.add(data)
    wrong = arrived = attempts = 0

    def line(symbols: Symbols) -> Symbols:
        nonlocal wrong, arrived, attempts
        attempts = max(attempts, *outbox.attempts.values(), 0)
        received = noisy(symbols.copy())
        arrived += int((received != 255).sum())
        wrong += int(((received != symbols) & (received != 255)).sum())
        return received

    assert transmit(outbox, inbox, line) == data
    assert wrong > 0
    assert attempts > 16 or loss  # a frame came wrong many times
    assert inbox.symbols_seen == arrived > 4 * len(data)
    assert (inbox.symbol_errors, int(inbox.confusion.sum())) == (wrong, arrived)


def test_refills_without_an_open_symbol_are_refused() -> None:
    inbox = Inbox(16, PLAIN)
    with pytest.raises(FramingError, match="refills more than is open"):
        inbox.block(Block(1, 1, 3, 3, 0, ()), np.zeros(3, dtype=np.uint8))
