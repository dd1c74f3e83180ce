"""The input of `qmn netqasm`, of a folder and of the command line, before anything is started."""

import argparse
from dataclasses import replace
from pathlib import Path

import netqasm.examples.apps
import pytest

from qmn.jobs.carried import new_of
from qmn.jobs.netqasm import checked, placement, with_machines
from qmn.options import BadInput
from qmn.verbs.netqasm import add_parser, request_of
from wire.packed_folder import Entry, Kind

APPS = Path(netqasm.examples.apps.__file__).parent
HOSTS = ["alice", "bob", "charlie"]


def application(folder: Path, *words: str) -> object:
    """Return what the command line asks for, checked."""
    parser = argparse.ArgumentParser()
    add_parser(parser.add_subparsers())
    arguments = parser.parse_args(["netqasm", str(folder), *words])
    return checked(request_of(arguments), HOSTS)


def test_roles_are_at_the_hosts_of_their_names_and_others_where_there_is_room() -> None:
    assert placement(["bob", "client", "server"], {}, HOSTS) == {
        "bob": "bob",
        "client": "alice",
        "server": "charlie",
    }
    assert placement(["alice", "bob"], {"alice": "bob", "bob": "alice"}, HOSTS) == {
        "alice": "bob",
        "bob": "alice",
    }


def test_inputs_come_from_files_and_the_command_line_which_goes_first(tmp_path: Path) -> None:
    for role in ("alice", "bob"):
        (tmp_path / f"app_{role}.py").write_text("")
    (tmp_path / "alice.yaml").write_text("x: 1\nname: left\n")
    (tmp_path / "roles.yaml").write_text("alice: bob\nbob: charlie\n")
    words = ["--input", "alice.x=0.5", "--place", "bob=alice", "--rounds", "3"]
    found = application(tmp_path, *words)
    assert found.inputs == {"alice": {"x": 0.5, "name": "left"}, "bob": {}}  # type: ignore[attr-defined]
    assert found.hosts == {"alice": "bob", "bob": "alice"}  # type: ignore[attr-defined]
    assert found.rounds == 3  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--place", "eve=alice"], "eve: the application has receiver, sender"),
        (["--place", "sender=eve"], "sender on eve: choose one of alice, bob, charlie"),
        (["--place", "sender"], "write ROLE=HOST"),
        (["--place", "sender=bob", "--place", "receiver=bob"], "two roles on one host"),
        (["--input", "phi=1"], "write ROLE.NAME=VALUE"),
        (["--input", "sender.phi=["], "--input sender.phi=["),
        (["--rounds", "0"], "--rounds 0: choose 1 to"),
    ],
)
def test_what_cannot_be_is_refused_by_name(words: list[str], text: str) -> None:
    with pytest.raises(BadInput) as refused:
        application(APPS / "teleport", *words)
    assert text in str(refused.value)


def test_a_netqmpi_program_has_as_many_roles_as_ranks(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text("")
    found = application(program, "--ranks", "2", "--place", "rank_1=charlie", "--rounds", "3")
    assert found.path == program  # type: ignore[attr-defined]
    assert found.hosts == {"rank_0": "alice", "rank_1": "charlie"}  # type: ignore[attr-defined]
    for words, text in (
        ([], "--ranks says on how many hosts"),
        (["--ranks", "1"], "--ranks 1: choose 2 to"),
        (["--ranks", "4"], "4 roles and 3 hosts: choose a larger --topology"),
        (["--ranks", "2", "--input", "rank_0.x=1"], "write it into the program"),
    ):
        with pytest.raises(BadInput, match=text):
            application(program, *words)
    with pytest.raises(BadInput, match=r"is for a NetQMPI program, FILE\.py"):
        application(APPS / "teleport", "--ranks", "2")
    with pytest.raises(BadInput, match=r"there is no .*/nowhere\.py"):
        application(tmp_path / "nowhere.py", "--ranks", "2")
    (tmp_path / "program.txt").write_text("")
    with pytest.raises(BadInput, match=r"it is FILE\.py"):
        application(tmp_path / "program.txt", "--ranks", "2")


def test_what_is_no_application_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"has no app_ROLE\.py"):
        application(tmp_path)
    with pytest.raises(BadInput, match="4 roles and 3 hosts: choose a larger --topology"):
        application(APPS / "anonymous_transmission")
    (tmp_path / "app_alice.py").write_text("")
    (tmp_path / "alice.yaml").write_text("- 1\n")
    with pytest.raises(BadInput, match="does not say values by name"):
        application(tmp_path)


def test_over_several_machines_places_are_also_of_hosts() -> None:
    parser = argparse.ArgumentParser()
    add_parser(parser.add_subparsers())
    places = ["sender=bob", "bob=m2", "receiver=charlie", "alice=bob", "eve=m2"]
    words = [word for place in places for word in ("--place", place)]
    command = ["netqasm", str(APPS / "teleport"), *words]
    request = with_machines(request_of(parser.parse_args([*command, "--machines", "2"])), HOSTS)
    assert request.run.place == ("bob=m2",)
    assert request.place == ("sender=bob", "receiver=charlie", "alice=bob", "eve=m2")
    assert request.run.machines == 2
    alone = with_machines(request_of(parser.parse_args(command)), HOSTS)
    assert (alone.run.place, alone.place) == ((), tuple(places))


def test_of_a_copy_only_what_is_new_comes_back_with_the_folders_that_it_is_in() -> None:
    before = [
        Entry("a", Kind.FOLDER),
        Entry("a/b", Kind.FOLDER),
        Entry("a/b/same", Kind.FILE, 1, b"1"),
        Entry("c", Kind.FOLDER),
        Entry("c/changed", Kind.FILE, 1, b"1"),
    ]
    changed, new = Entry("c/changed", Kind.FILE, 2, b"2"), Entry("a/new", Kind.FILE, 2, b"")
    after = [*before[:2], replace(before[2], changed_ns=2), new, before[3], changed]
    assert new_of(after, before) == [before[0], new, before[3], changed]
    assert new_of(before, before) == []
