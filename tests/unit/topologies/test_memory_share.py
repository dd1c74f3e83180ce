"""How much memory of this machine a host may take."""

from pathlib import Path

import pytest

from topologies.system.kernel import memory_share
from topologies.system.kernel.memory_share import V2, checked_mib, groups_of_gone, parent
from topologies.system.processes.owners import namespace, this_process
from wire.parameters.physics import BadParameter


def test_without_a_word_it_is_half_of_the_machines() -> None:
    (total,) = (
        int(line.split()[1])
        for line in Path("/proc/meminfo").read_text().splitlines()
        if line.startswith("MemTotal:")
    )
    # The kernel tells both in pages of its own and in KiB.
    assert abs(checked_mib("alice", None) - total / 1024 / 2) <= 1


@pytest.mark.parametrize("asked", [0, 63, -1, 128.0, "128", True])
def test_what_is_no_share_is_refused_by_name(asked: object) -> None:
    with pytest.raises(BadParameter, match=r"alice: memory_mib .* is not a whole number of at lea"):
        checked_mib("alice", asked)


def test_version_2_is_used_where_it_is_delegated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As Linux documents it (admin-guide/cgroup-v2): a child limits what its parent delegates."""
    own = tmp_path / "own"
    own.write_text("0::/user.slice/session-1.scope\n")
    monkeypatch.setattr(memory_share, "OWN_GROUPS", own)
    monkeypatch.setattr(memory_share, "TOP", tmp_path)
    assert parent() is None
    (tmp_path / "cgroup.subtree_control").write_text("cpu pids\n")
    assert parent() is None
    (tmp_path / "cgroup.subtree_control").write_text("cpu memory pids\n")
    assert parent() == (tmp_path, V2)


def test_where_nothing_can_be_written_there_is_no_group(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = tmp_path / "own"
    own.write_text("4:memory:/nobody\n0::/\n")
    monkeypatch.setattr(memory_share, "OWN_GROUPS", own)
    monkeypatch.setattr(memory_share, "TOP", tmp_path)
    assert parent() is None


def test_only_groups_of_runs_that_have_ended_are_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory_share, "parent", lambda: (tmp_path, V2))
    ended = this_process()._replace(start=1)
    left = tmp_path / f"qmn.{namespace()}.{ended}.erin"
    left.mkdir()
    (tmp_path / f"qmn.{namespace()}.{this_process()}.alice").mkdir()
    (tmp_path / "system.slice").mkdir()
    assert [*groups_of_gone()] == [left]
