"""The input of a user is checked before anything starts."""

import os
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from qmn.__main__ import described
from qmn.jobs import superdense
from qmn.network.custom_topology import BadTopology
from qmn.network.description import NetworkDescription, describe_network
from qmn.options import BadInput
from qmn.requests.superdense import SuperdenseRequest
from qmn.results.run_folder import begin_folder, make_folder, point_latest
from qmn.verbs.run import superdense_request
from topologies.catalogue.node_kinds import ION_TRAP
from topologies.catalogue.presets import PRESETS
from topologies.links.fiber import FiberLink
from topologies.networks.network import Signals
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.programs import NetworkError
from topologies.system.runs import runtime
from wire.parameters.fiber import FiberOptics
from wire.parameters.physics import Device, Gates


def parse(*words: str) -> SuperdenseRequest:
    """Return what the command line asks for."""
    whole = ["run", "sdc", *words]
    return superdense_request(described(whole).parse_args(whole))


def network(*words: str) -> NetworkDescription:
    """Return the network that the command line describes."""
    return describe_network(parse(*words).network)


def checked(*words: str) -> int:
    """Return the size of the message."""
    return superdense.check_input(parse(*words), network(*words).hosts)


MY_NET = f"{Path(__file__).resolve().parents[3]}/examples/my_net.py:MyNet"


def test_hosts_that_a_topology_of_ones_own_does_not_have_are_to_be_named() -> None:
    with pytest.raises(BadInput) as caught:
        checked("--topology", MY_NET)
    words = "unknown host 'alice': choose two of h1, h2, src by --from and --to"
    assert str(caught.value) == words
    with pytest.raises(BadInput, match=r"^unknown host 'srk': did you mean src\?$"):
        checked("--topology", MY_NET, "--from", "srk", "--to", "h1")


def test_a_run_that_is_refused_for_a_bridge_of_the_machine_leaves_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "run")
    monkeypatch.setattr("topologies.networks.requirements.require_root", lambda: None)
    monkeypatch.setattr("topologies.networks.requirements.are_own", lambda: False)
    runs = tmp_path / "runs"
    before = make_folder(runs, "sdc")
    point_latest(before)
    request = parse("--runs", str(runs))
    bridges = ["s1"]
    monkeypatch.setattr(openvswitch, "bridges", lambda: bridges)
    with Signals() as signals:
        with pytest.raises(NetworkError, match=r"^bridge s1 exists already and is not ours"):
            superdense.begun(request, signals, Console(file=StringIO()))
        assert {path.name for path in runs.iterdir()} == {"latest", before.name}
        assert (runs / "latest").resolve() == before
        bridges.clear()
        _job, context = superdense.begun(request, signals, Console(file=StringIO()))
        assert (runs / "latest").resolve() == context.folder != before


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--file", "/nowhere"], "cannot read /nowhere: No such file"),
        (["--frame-bytes", "70000"], "--frame-bytes 70000: choose 1 to 65536"),
        (["--depolarizing", "1.5"], "depolarizing 1.5: choose 0 to 1"),
        (["--length-km", "20001"], "every fibre: length_km 20001.0: choose 0 to 20000"),
        (
            ["--fiber", "drift=1"],
            "--fiber drift=1: a fibre has no drift: ",
        ),
        (
            ["--fiber", "filter_nm"],
            "--fiber filter_nm: write NAME=VALUE",
        ),
        (
            ["--fiber", "filter_nm=long"],
            "--fiber filter_nm=long: 'long': choose a number of nm",
        ),
        (["--fiber", "noise_parameters={"], "--fiber noise_parameters={: Expecting"),
        (["--fiber", "noise=no.py:Noise"], "there is no file /"),
        (["--fiber", f"noise={__file__}:run"], "has no class run with a method effect"),
        (
            ["--device", "bob.detectors"],
            "--device bob.detectors: write HOST.PART.NAME=VALUE, * for every HOST, and PART of s",
        ),
        (
            ["--device", "bob.detector.efficiency=1"],
            "a device has no detector: did you mean detectors?",
        ),
        (
            ["--device", "bob.lasers.efficiency=1"],
            "a device has no lasers: choose one of source, mem",
        ),
        (["--device", "bob.detectors.eficiency=1"], "detectors has no eficiency: did you mean eff"),
        (["--device", "bob.detectors.efficiency=2"], "bob, detectors: efficiency 2.0: choose 0 to"),
        (["--device", "bob.memory.capacity=many"], "capacity=many: 'many': choose a whole number"),
        (["--device", "charlie.source.bell_diagonal=1"], "bell_diagonal=1: 'int' object"),
        (
            ["--device", "bob.memory.t2_s=1", "--device", "bob.memory.t1_s=.1"],
            ": choose 1e-12 to 0.2",
        ),
        (["--node", "warp-core"], "--node 'warp-core': choose one of photonic, ion-trap"),
        (["--node", "station"], "--node 'station': choose one of photonic, ion-trap"),
        (["--node", "bob=warp-core"], "--node bob: 'warp-core': choose one of"),
        (["--node", "bob.memory.t2_s=1"], "settings of hosts are words of --device"),
        (["--switch", "q1.parts=x"], "--switch q1.parts=x: parts 'x': choose one of photonic"),
        (["--node", "ed=photonic"], "--node or --device ed: choose one of alice, bob, charlie"),
        (["--node", "photonic", "--node", "ion-trap"], "--node ion-trap: choose one for all"),
        (["--node", "bob="], "--node bob=: write KIND, or HOST=KIND once a host, of photonic"),
        (["--node", "bob=photonic", "--node", "bob=ion-trap"], "HOST=KIND once a host"),
        (
            ["--node", "ion-trap", "--device", "bob.gates.kind=paulis"],
            "bob, analyser: kind 'gates' with gates of kind 'paulis'",
        ),
        (["--device", "ed.memory.capacity=1"], "--device ed: choose one of alice, bob, charlie"),
        (["--rate-hz", "0"], "--rate-hz 0"),
        (
            ["--to", "ed"],
            "unknown host 'ed': choose two of alice, bob, c",
        ),
        (["--from", "bob"], "sender and receiver are both bob"),
        (["--policy", "/nowhere.toml"], "cannot read the policy /nowhere.toml: No such file"),
        (["--rest", "127.0.0.1:8080", "--controller", "os-ken"], "--rest needs --controller ryu"),
        (["--sabot", "/nowhere"], "start one with python -m dispatcher.sabot --socket /nowhere"),
        (["--topology", "chain,0"], "0 quantum switches: choose 1 to 256"),
        (["--topology", "ring,2"], "2 quantum switches: choose 3 to 256"),
        (["--topology", "leaf-spine,0"], "0 leaves and 2 spines: choose 1 or more"),
        (["--topology", "leaf-spine,255"], "257 quantum switches"),
        (["--topology", "tree,2"], "2 hosts: choose 3 to 1024"),
        (
            ["--topology", "map,abilen"],
            "there is no map 'abilen': choose one of topohub's, such as abil",
        ),
        (
            ["--topology", "map,abilene"],
            "unknown host 'alice': choose two of atlam5, a",
        ),
        (["--topology", "map,abilene", "--length-km", "3"], "the map says how long fibres are"),
        (["--loss-budget-db", "-1"], "--loss-budget-db -1.0: choose 0 to 1000"),
        (
            ["--time", "paced", "--host-delay", "1ms"],
            "in stepped time alone: leave --time paced out",
        ),
        (["--interleave"], "--interleave spreads the codewords of a code: choose one with --fec"),
        (
            ["--fec", "golay", "--frame-bytes", "65536"],
            "--frame-bytes 65536 with --fec golay: a frame needs 502,447 pairs, at most 262,144",
        ),
        (["--handshake", "per-pair", "--message", "x" * 70_000], "use --handshake framed"),
    ],
)
def test_bad_input_names_the_value_and_what_to_choose(words: list[str], text: str) -> None:
    with pytest.raises((BadInput, BadTopology)) as caught:
        checked(*words)
    assert text in str(caught.value)


@pytest.mark.parametrize(("words", "size"), [(["--message", ""], 0), (["--message", "ä"], 2)])
def test_the_size_is_that_of_the_bytes(words: list[str], size: int) -> None:
    assert checked(*words) == size


@pytest.mark.parametrize(
    ("words", "pairs"),
    [
        ([], 4 * 1000),
        (["--fec", "repetition"], 12 * 1000),
        (["--fec", "reed-solomon", "--frame-bytes", "223"], 4 * (1000 + 5 * 32)),
        (["--fec", "reed-solomon", "--handshake", "per-pair"], 4 * (1000 + 63 * 32)),
    ],
)
def test_the_pairs_that_a_message_needs_follow_from_its_code(words: list[str], pairs: int) -> None:
    assert superdense.pairs_of(parse(*words).options, 1000) == pairs


def test_there_is_a_message_without_being_asked() -> None:
    assert checked() > 0


def test_sizes_reach_the_topology() -> None:
    chain = network("--topology", "chain,5", "--length-km", "2").topo
    assert len([name for name in chain.switches() if name.startswith("q")]) == 5
    fibers = [info for *_, info in chain.links(withInfo=True) if info["cls"] is FiberLink]
    assert {info["length_km"] for info in fibers} == {2.0}


def test_parameters_of_fibres_reach_the_topology() -> None:
    words = ["--preset", "metro", "--kind", "pm", "--fiber", "dephasing=0.1", "--length-km", "2"]
    fibre = network(*words).every_fiber
    assert fibre is not None
    assert (fibre.kind, fibre.length_km, fibre.dephasing) == ("pm", 2.0, 0.1)
    assert (fibre.connectors_db, fibre.loss_db_per_km) == (0.5, 0.5)
    assert network().every_fiber == FiberOptics()


def test_two_runs_in_one_second_have_folders_of_their_own(tmp_path: Path) -> None:
    first, second = make_folder(tmp_path, "sdc"), make_folder(tmp_path, "sdc")
    assert first != second
    for folder in (first, second):
        point_latest(folder)
        assert os.readlink(tmp_path / "latest") == folder.name


@pytest.mark.parametrize(
    ("blocked", "text"),
    [
        ("runs/latest/file", "runs/latest: Is a directory"),
        ("runs", "runs: Not a directory|runs: File exists"),
    ],
)
def test_where_no_folder_of_a_run_can_be_made_the_place_is_said(
    tmp_path: Path, blocked: str, text: str
) -> None:
    (tmp_path / blocked).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / blocked).touch()
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(BadInput, match=f"cannot write to --runs .*({text})"):
        begin_folder(tmp_path / "runs", "sdc")
    assert sorted(tmp_path.rglob("*")) == before


def test_devices_are_those_of_the_preset_but_for_what_is_said() -> None:
    words = ["--preset", "lab", "--device", "bob.analyser.kind=linear"]
    words += ["--device", "charlie.source.bell_diagonal=[0.97, 0.01, 0.01, 0.01]"]
    words += ["--device", "charlie.source.fidelity=1"]
    text = network(*words).stated_devices
    preset = network("--preset", "lab").topo.nodeInfo("bob")["device"]
    assert text["bob"].detectors == preset.detectors
    assert text["bob"].analyser.kind == "linear"
    assert text["charlie"].to_dict()["source"] == {"bell_diagonal": (0.97, 0.01, 0.01, 0.01)}
    built = network(*words).topo
    assert built.nodeInfo("bob")["device"] == text["bob"]
    assert built.nodeInfo("alice")["device"] == preset
    assert network().stated_devices == {"every": Device()}


def test_hosts_are_of_the_kinds_that_are_named_but_for_what_is_said_of_them() -> None:
    words = ["--preset", "metro", "--node", "ion-trap", "--node", "bob=photonic"]
    words += ["--device", "alice.memory.capacity=7"]
    built = network(*words).topo
    alice, bob, charlie = (built.nodeInfo(host)["device"] for host in ("alice", "bob", "charlie"))
    assert charlie == ION_TRAP
    assert alice == replace(ION_TRAP, memory=replace(ION_TRAP.memory, capacity=7))
    metro = PRESETS["metro"].device
    assert bob == replace(metro, gates=Gates("paulis"))


def test_a_message_and_a_file_are_not_sent_together(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse("--message", "hello", "--file", "letter")
    assert "--file: not allowed with argument --message" in capsys.readouterr().err
