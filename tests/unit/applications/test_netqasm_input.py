"""The input of `qmn netqasm`, of a folder and of the command line, before anything is started."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import netqasm.examples.apps
import pytest

from applications.netqasm.carried import new_of
from applications.netqasm.job import checked, placement, with_machines
from applications.netqasm.request import NetqasmRequest
from applications.netqasm.verb import add_parser, request_of
from qmn.options import BadInput
from wire.packed_folder import Entry, Kind

APPS = Path(netqasm.examples.apps.__file__).parent
HOSTS = ["alice", "bob", "charlie"]


def request(folder: Path, *words: str) -> NetqasmRequest:
    """Return the request of a command line."""
    parser = argparse.ArgumentParser()
    add_parser(parser.add_subparsers())
    return request_of(parser.parse_args(["netqasm", str(folder), *words]))


def application(folder: Path, *words: str) -> object:
    """Return what the command line asks for, checked."""
    return checked(request(folder, *words), HOSTS)


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
        (["--input", "sender.thetha=2"], "main of app_sender.py has no such parameter: did you"),
        (["--input", "receiver.theta=2"], "input receiver.theta: main of app_receiver.py has no"),
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


@pytest.mark.parametrize(
    ("program", "words", "text"),
    [
        ("def main(app_config=None, *, rounds=1): ...", ["rond=2"], "no such parameter: did you"),
        ("def main(app_config=None, x=0): ...", ["zeta=2"], "choose one of x (--input or alice"),
        ("def main(app_config): ...", ["x=2"], "it takes no input (--input or alice.yaml)"),
        ("def main(app_config): ...", ["app_config=2"], "it takes no input (--input"),
        ("def main(app_config, x, y=1): ...", ["y=2"], "needs x: give --input alice.x=VALUE"),
        ("def main(app_config=None, *, x): ...", [], "needs x: give --input alice.x=VALUE"),
        ("x = 1\ndef main(:\n", [], "app_alice.py, line 2"),
    ],
)
def test_inputs_that_main_does_not_take_are_refused(
    tmp_path: Path, program: str, words: list[str], text: str
) -> None:
    (tmp_path / "app_alice.py").write_text(program)
    inputs = [part for word in words for part in ("--input", f"alice.{word}")]
    with pytest.raises(BadInput) as refused:
        application(tmp_path, *inputs)
    assert text in str(refused.value)


@pytest.mark.parametrize(
    "program",
    [
        "def main(app_config=None, **inputs): ...",
        "def main(app_config, x, y=1): ...",
        "from elsewhere import main",
        "@wrapped\ndef main(): ...",
    ],
)
def test_inputs_that_main_may_take_are_given(tmp_path: Path, program: str) -> None:
    (tmp_path / "app_alice.py").write_text(program)
    (tmp_path / "alice.yaml").write_text("x: 3\n")
    assert application(tmp_path).inputs == {"alice": {"x": 3}}  # type: ignore[attr-defined]


@pytest.mark.parametrize("apps", ["apps", "qne_apps"])
def test_all_applications_of_the_sdk_are_accepted(apps: str) -> None:
    folders = [file.parent for file in (APPS.parent / apps).glob("*/app_*.py")]
    assert len(folders) > 10
    hosts = [*HOSTS, "dave"]
    for folder in folders:
        assert checked(request(folder), hosts).path == folder.resolve()


NETWORK = """
nodes:
  - {name: delft, gate_fidelity: 0.95, qubits: [{id: 0, t1: 0, t2: 0}]}
  - {name: leiden, gate_fidelity: 1, qubits: [{id: 0, t1: 1000, t2: 0}]}
links:
  - {name: ch1, node_name1: delft, node_name2: leiden, noise_type: Depolarise, fidelity: 0.8}
  - {name: ch2, node_name1: delft, node_name2: alice, noise_type: NoNoise, fidelity: 0.5}
"""


def test_nodes_of_a_simulators_network_are_hosts_of_ours(tmp_path: Path) -> None:
    for role in ("david", "alice", "bob"):
        (tmp_path / f"app_{role}.py").write_text("")
    (tmp_path / "roles.yaml").write_text("david: delft\nalice: leiden\nbob: charlie\n")
    found: Any = application(tmp_path)
    assert found.hosts == {"alice": "alice", "bob": "charlie", "david": "bob"}
    assert found.notes == [
        "roles.yaml: there is no host delft, leiden; david on bob, alice on alice"
    ]
    (tmp_path / "network.yaml").write_text(NETWORK)
    found = application(tmp_path, "--place", "david=alice", "--place", "alice=bob")
    assert found.hosts == {"alice": "bob", "bob": "charlie", "david": "alice"}
    assert found.notes[1] == (
        "network.yaml is not applied: fidelity 0.8 (Depolarise) of ch1, gate_fidelity 0.95 "
        "of delft, t1 and t2 of leiden; set noise by --depolarizing and --device"
    )
    (tmp_path / "network.yaml").write_text("links: [{name: ch1}]\n")
    with pytest.raises(BadInput, match="is not a network of `netqasm simulate`"):
        application(tmp_path)


def test_what_is_no_application_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"has no app_ROLE\.py"):
        application(tmp_path)
    with pytest.raises(BadInput, match="4 roles and 3 hosts: choose a larger --topology"):
        application(APPS / "anonymous_transmission")
    (tmp_path / "app_alice.py").write_text("")
    for content in (b"- 1\n", b"\xff\xfe\n", b"[" * 5_000, b"x: : [\n"):
        (tmp_path / "alice.yaml").write_bytes(content)
        with pytest.raises(BadInput, match=r"^cannot read .*alice\.yaml: "):
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
