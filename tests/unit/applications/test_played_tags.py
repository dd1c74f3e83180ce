"""Tags that a host plays in place of its detectors."""

import asyncio
import os
from pathlib import Path

import numpy as np
import pytest
from limits import SOON_S

from applications.interception.photons import resend
from applications.time_tags import played, words
from applications.time_tags.played import PlayedQnic, Tags, play, read
from hosts.hardware import pair_light
from hosts.hardware.block_name import BlockName
from hosts.hardware.replies import HardwareError
from topologies.sdc import SdcTopo
from wire.parameters.physics import BadParameter


def file_of(path: Path, units: list[int], patterns: list[int]) -> str:
    path.write_bytes(words.encode(np.array(units), np.array(patterns, np.uint8)))
    return str(path)


def test_a_slot_has_the_outcome_of_its_only_tag() -> None:
    units = np.array([3, 12, 15, 25, 31, 47, 48])
    tags = Tags(units, np.array([1, 2, 4, 8, 5, 4, 4], np.uint8), 10)
    at, channels = tags.within(0, 100)
    # Two of slot 1, a tag of two detectors, and two of slot 4 are left out.
    assert at.tolist() == [0, 2]
    assert channels.tolist() == [0, 3]
    at, _channels = tags.within(2, 1)
    assert at.tolist() == [0]


def test_slots_begin_with_the_first_tag_of_either_host(tmp_path: Path) -> None:
    topo = SdcTopo()
    files = {
        "alice": file_of(tmp_path / "a", [1000, 2000], [1, 1]),
        "bob": file_of(tmp_path / "b", [1900, 2900], [1, 4]),
    }
    play(topo, files, slot_ps=1000, ahead_ps={"bob": 125_000})
    begins = {host: topo.nodeInfo(host)["qnic_parameters"]["begin_units"] for host in files}
    assert begins == {"alice": 900, "bob": 1900}
    assert topo.nodeInfo("bob")["qnic_parameters"]["slot_units"] == 8
    with pytest.raises(BadParameter, match="slot_ps 100: choose 125 or more"):
        play(topo, files, slot_ps=100)
    with pytest.raises(BadParameter, match="slot_ps 1100: choose a multiple of 125"):
        play(topo, files, slot_ps=1100)
    with pytest.raises(BadParameter, match="ahead_ps of bob 60: choose a multiple of 125"):
        play(topo, files, slot_ps=1000, ahead_ps={"bob": 60})


def test_files_between_which_times_begin_again_are_refused(tmp_path: Path) -> None:
    """Times begin again after 2^49 units: bob's tag is the one behind alice's."""
    files = {
        "alice": file_of(tmp_path / "a", [(1 << 49) - 1], [1]),
        "bob": file_of(tmp_path / "b", [1 << 49], [1]),
    }
    with pytest.raises(BadParameter, match="times begin again between them"):
        play(SdcTopo(), files, slot_ps=1000)


def test_what_tags_do_not_take_the_place_of_is_refused(tmp_path: Path) -> None:
    """Before the dispatcher hears of it: there is none."""
    file = file_of(tmp_path / "a", [1000], [1])
    qnic = PlayedQnic("127.0.0.1:1", "", ["bob-q0"], file=file, begin_units=0, slot_units=8)
    block, other = BlockName(1, 1, 0), BlockName(1, 1, 1)
    for measurement in (
        qnic.measure(block, np.zeros(4, np.uint8)),
        resend(qnic, block, np.zeros(4, np.uint8)),
        qnic.bell_measure(block, other),
        pair_light.detect_pairs(qnic, 1, 1, ("bob-q0", "bob-q0"), SOON_S, following=True),
    ):
        with pytest.raises(HardwareError, match="tags are played for keys of --protocol bbm92"):
            asyncio.run(asyncio.wait_for(measurement, SOON_S))


def test_a_file_that_is_not_of_tags_is_refused_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "tags"
    with pytest.raises(BadParameter, match=r"has no tags to play: .*No such file"):
        read(path)
    for data, text in ((b"", "it is empty"), (bytes(9), "9 bytes"), (bytes(8), "of no detector")):
        path.write_bytes(data)
        with pytest.raises(BadParameter, match=text):
            read(path)
    os.mkfifo(tmp_path / "fifo")
    for other in (Path("/dev/zero"), tmp_path / "fifo"):
        with pytest.raises(BadParameter, match="is not a file"):
            read(other)
    monkeypatch.setattr(played, "MOST_BYTES", 7)
    with pytest.raises(BadParameter, match="more than 7 bytes"):
        read(Path("/proc/version"))  # whose size the system says to be 0
    with pytest.raises(BadParameter, match="more than 7 bytes"):
        read(path)
