"""Applications that carry bytes: how many at a time, and into which files.

2^20 pairs of two bits are 2^18 bytes.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO

import pytest
from limits import SOON_S

from hosts.applications.carrying import CHUNK_BYTES, first_chunk, next_chunk, written_whole

FIRST = CHUNK_BYTES["framed"]
GOOD = {"bell_pairs": 1_000, "received_symbols": 1_000, "rate_hz": 50_000_000, "code_rate": 1.0}


@pytest.mark.parametrize(
    ("used", "size"),
    [
        ({}, 1 << 18),
        ({"received_symbols": 500}, 1 << 17),
        ({"code_rate": 0.5}, 1 << 17),
        ({"received_symbols": 800}, 3 * FIRST),  # 0.8 * 2^18 are 3.2 times the first
        ({"received_symbols": 10}, FIRST),
        ({"received_symbols": 0}, FIRST),
        ({"bell_pairs": 0, "received_symbols": 0}, FIRST),
        ({"rate_hz": 10_000}, FIRST),  # in 5 s 12,500 bytes
        ({"rate_hz": 110_000}, 2 * FIRST),  # 137,500 bytes
    ],
)
def test_more_is_sent_at_a_time_where_more_light_arrives(used: dict[str, int], size: int) -> None:
    assert next_chunk(FIRST, {**GOOD, **used}) == size


def test_pairs_with_handshakes_of_their_own_stay_few() -> None:
    assert next_chunk(CHUNK_BYTES["per-pair"], GOOD) == CHUNK_BYTES["per-pair"]


@pytest.mark.parametrize(
    ("options", "size"),
    [
        ({"handshake": "framed", "block_pairs": 131_072}, 1 << 16),
        ({"block_pairs": 128, "frame_bytes": 8}, 1 << 13),  # 256 blocks of 32 bytes
        ({"block_pairs": 128, "frame_bytes": 64}, 1 << 14),  # 256 blocks of a frame each
        ({"block_pairs": 128, "frame_bytes": 4096}, 1 << 16),
        ({"handshake": "per-pair", "block_pairs": 131_072}, 16),
        ({}, 1 << 16),
    ],
)
def test_of_small_blocks_so_few_are_sent_at_a_time_that_their_progress_is_told(
    options: dict[str, int | str], size: int
) -> None:
    assert first_chunk(options) == size


def write_half(opened: BinaryIO) -> None:
    opened.write(b"half")
    raise EOFError


def test_a_file_is_there_only_if_all_of_it_has_come(tmp_path: Path) -> None:
    output = tmp_path / "received"
    output.write_bytes(b"of another session")
    with pytest.raises(EOFError), written_whole(output) as opened:
        write_half(opened)
    assert output.read_bytes() == b"of another session"
    with written_whole(output) as opened:
        opened.write(b"whole")
    assert output.read_bytes() == b"whole"
    assert list(tmp_path.iterdir()) == [output]


def test_a_pipe_stays_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with ThreadPoolExecutor(1) as pool:
        read = pool.submit(pipe.read_bytes)
        with written_whole(pipe) as opened:
            opened.write(b"what has come")
        assert read.result(SOON_S) == b"what has come"
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]
