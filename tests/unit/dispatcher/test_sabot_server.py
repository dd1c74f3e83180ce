"""Sabot in another process: same results as in the dispatcher, and nothing that harms it."""

import os
import signal
import stat
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import forked_python
import grpc
import numpy as np
import pytest
import uvloop
from channels_of_qubits import damping
from dispatcher_network import (
    Bench,
    JumpingClock,
    block,
    configuration,
    running,
    with_fibers,
)
from limits import SOON_S
from sabot_scene import (
    DRAWS,
    PAIRS,
    PREPARED,
    REFUSED,
    Code,
    gather,
    measure,
    prepare,
    serving_in,
    status,
    stub_of,
)

from applications.sabot_server import client
from applications.sabot_server.client import RemoteSabot, SabotUnreachable
from applications.sabot_server.requests import MAX_WORKSPACES
from dispatcher.sabot.backends import BACKENDS
from dispatcher.sabot.dense import TooLarge
from dispatcher.sabot.draws import Draws, PhotonDraws
from dispatcher.sabot.manager import Sabot
from dispatcher.sabot.registers import Pick, Register
from dispatcher.sabot.simulation import Simulation
from wire import sabot_pb2 as messages
from wire.dispatcher_pb2 import (
    ApplyRequest,
    CreateRequest,
    Feedback,
    Gate,
    GatherRequest,
    MeasureRequest,
    ResendRequest,
)
from wire.positions import pack


class Experiment:
    """The same random steps on any simulation; what they find is noted."""

    def __init__(self, sabot: Simulation, seed: int) -> None:
        """Begin with two blocks of Bell pairs."""
        self.sabot, self.random, self.draws = sabot, np.random.default_rng(seed), Draws(seed)
        self.size = 6
        self.registers = [*sabot.bell_pairs(self.size), *sabot.bell_pairs(self.size)]
        self.found: list[Any] = []
        self.number = 0

    def photons(self) -> Any:
        """Return random numbers that were not used yet."""
        self.number += 1
        return self.draws.photons((7, self.number, 0), "test", self.size)

    def step(self) -> None:
        """Do one random thing, and note what can be seen."""
        which, target = (int(index) for index in self.random.permutation(4)[:2])
        register, other = self.registers[which], self.registers[target]
        values = self.random.integers(0, 4, self.size, dtype=np.uint8)
        kinds = 11 if self.sabot.backend == "dense" else 10
        self.act(int(self.random.integers(kinds)), which, register, other, values)
        self.found.append((self.sabot.live_qubits, register.remaining, register.present.tolist()))

    def act(self, kind: int, which: int, register: Register, other: Register, values: Any) -> None:
        """Do a thing of this kind."""
        sabot = self.sabot
        if kind == 0:
            sabot.pauli(register, values)
        elif kind == 1:
            sabot.gate("H" if values[0] % 2 else "S", register)
        elif kind == 2:
            sabot.gate("CX", register, other)
        elif kind == 3:
            self.found.append(sabot.lose(register, values == 0))
        elif kind == 4:
            sabot.reset(register, values == 1, self.photons())
        elif kind == 5:
            part = sabot.part(register, values > 1)
            self.found += [part.present.tolist(), register.present.tolist()]
            sabot.gate("H", part)
            sabot.unite(register, part)
        elif kind == 6:
            self.found.append(sabot.simulated_by(register))
            self.found.append(sabot.measure(register, values % 3, self.photons()).tolist())
            self.registers[which] = sabot.zeros(self.size)
        elif kind == 7:
            pair = self.photons(), self.photons()
            self.found.append(sabot.bell_measure(register, other, pair).tolist())
            self.registers[which] = sabot.zeros(self.size)
            self.registers[self.registers.index(other)] = sabot.zeros(self.size)
        elif kind == 8:
            self.gather(which, register, other)
        elif kind == 10:
            own = np.array([damping(0.2 * int(value)) for value in values])
            sabot.kraus(register, own, values != 1, self.photons())
            sabot.kraus(other, damping(0.5), values == 0, self.photons())
        else:
            sabot.drop(register, self.photons())
            self.registers[which] = sabot.zeros(self.size)

    def gather(self, which: int, register: Register, other: Register) -> None:
        """Make a register of half of two others; one of these keeps its other half."""
        orders = [self.random.permutation(self.size).astype(np.uint32) for _ in range(2)]
        half = self.size // 2
        picks = [Pick(register, orders[0][:half]), Pick(other, orders[1][:half])]
        gathered = self.sabot.gather(picks)
        self.found += [gathered.present.tolist(), other.present.tolist()]
        self.sabot.drop(register, self.photons())
        self.registers[which] = gathered


@pytest.mark.parametrize("backend", sorted(BACKENDS))
def test_a_server_does_what_the_manager_does(tmp_path: Path, backend: str) -> None:
    with serving_in(tmp_path) as socket, RemoteSabot(socket, backend) as remote:
        for seed in range(2):
            here, there = (Experiment(s, seed) for s in (Sabot(BACKENDS[backend]), remote))
            there.found = []
            base = remote.live_qubits - 4 * here.size
            for _ in range(60):
                here.step()
                there.step()
            expected = [(e[0] + base, *e[1:]) if isinstance(e, tuple) else e for e in here.found]
            assert there.found == expected


def test_kraus_operators_of_many_qubits_are_sent_in_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client, "MAX_KRAUS_NUMBERS", 8 * 8)  # of eight qubits
    own = np.array([damping(position / 100) for position in range(100)])
    found = []
    with serving_in(tmp_path) as socket, RemoteSabot(socket, "dense") as remote:
        for sabot in (Sabot(BACKENDS["dense"]), remote):
            first, second = sabot.bell_pairs(100)
            draws = [Draws(1).photons((7, 0, 0), purpose, 100) for purpose in "abc"]
            sabot.kraus(first, own, np.arange(100) % 3 > 0, draws[0])
            found.append(sabot.bell_measure(first, second, (draws[1], draws[2])).tolist())
    assert found[0] == found[1]
    assert len(set(found[0])) == 4


def test_numbers_of_ones_own_are_those_that_decide(tmp_path: Path) -> None:
    """In X a |0> is found as its bit says, and in Z+X the same in either process."""
    bits, fractions = np.arange(100, dtype=np.uint8) % 2, np.linspace(0, 0.99, 100)
    found = []
    with serving_in(tmp_path) as socket, RemoteSabot(socket, "chp") as remote:
        for sabot in (Sabot(BACKENDS["chp"]), remote):
            for basis in (1, 3):
                own = PhotonDraws(bits.copy, fractions.copy)
                register = sabot.zeros(100)
                found.append(sabot.measure(register, np.full(100, basis, np.uint8), own).tolist())
        wrong = PhotonDraws(bits.copy, lambda: fractions + 1)
        with pytest.raises(SabotUnreachable, match="fractions"):
            remote.measure(remote.zeros(100), np.zeros(100, np.uint8), wrong)
    assert found[0] == bits.tolist()
    assert found[:2] == found[2:]


def test_kraus_operators_that_no_channel_has_are_refused(tmp_path: Path) -> None:
    numbers: dict[str, Any] = {"operators": 1, "real": [1, 0, 0, 1], "imaginary": [0, 0, 0, 0]}
    refused: dict[str, dict[str, Any]] = {
        "sum of K†K is [[0.25": {"real": [0.5, 0, 0, 0.5]},
        "not a number": {"real": [float("nan"), 0, 0, 1]},
        "operators 0; send 1 to 16": {"operators": 0},
        "operators 17": {"operators": 17},
        "4 real and 3 imaginary": {"imaginary": [0, 0, 0]},
        "4 real and 4 imaginary numbers for 2 operators": {"operators": 2},
        "0 real and 0 imaginary": {"real": [], "imaginary": []},
        "2 bytes for 4 qubits": {"mask": b"\x01\x01"},
    }
    with stub_of(tmp_path) as stub:
        for backend in ("dense", "chp"):
            workspace = stub.Begin(messages.BeginRequest(backend=backend)).workspace
            stub.Create(messages.CreateRequest(workspace=workspace, count=4, state=PAIRS))
        named: dict[str, Any] = {"workspace": 1, "register": 1, "mask": b"\x0f", "draws": DRAWS}
        for words, wrong in refused.items():
            with pytest.raises(grpc.RpcError) as raised:
                stub.Kraus(messages.KrausRequest(**{**named, **numbers, **wrong}))
            assert raised.value.code() == Code.INVALID_ARGUMENT
            assert words in str(raised.value.details())
        with pytest.raises(grpc.RpcError, match="on backend chp; begin a workspace on dense"):
            stub.Kraus(messages.KrausRequest(**{**named, **numbers, "workspace": 2}))
        stub.Kraus(messages.KrausRequest(**named, **numbers))
        answers = [stub.Measure(measure(register=n), timeout=SOON_S) for n in (1, 2)]
        assert answers[0].outcomes == answers[1].outcomes


def test_gates_that_are_not_clifford_bring_state_vectors_and_their_limits(tmp_path: Path) -> None:
    with serving_in(tmp_path) as socket, RemoteSabot(socket, "chp") as remote:
        register, other = remote.zeros(4), remote.zeros(4)
        assert remote.simulated_by(register) == "chp"
        remote.gate("RX", register, angle_rad=0.3)
        assert remote.simulated_by(register) == "dense"
        assert remote.simulated_by(register, other) == "chp+dense"
        chain = [remote.zeros(1) for _ in range(13)]
        remote.gate("T", chain[0])
        for first, second in pairwise(chain[:12]):
            remote.gate("CX", first, second)
        before = remote.live_qubits
        with pytest.raises(TooLarge, match="at most 12"):
            remote.gate("CX", chain[11], chain[12])
        remote.gate("H", chain[12])
        assert remote.live_qubits == before
        assert remote.simulated_by(chain[12]) == "chp"


async def transmission(folder: Path, **changes: Any) -> tuple[list[Feedback], str]:
    """Send noisy Bell pairs by the dispatcher's real service; return all answers and the log."""
    folder.mkdir()
    log = folder / "quantum.log"
    config = configuration(folder, event_log=str(log), **changes)
    config = with_fibers(config, loss_db_per_km=100.0, depolarizing=0.3)
    answers: list[Feedback] = []
    async with running(config, JumpingClock()) as bench:
        await bench.switch.connect((3, 4))
        answers.append(await bench.alice.create(200))
        answers.append(await bench.alice.create(100, number=1))
        answers.append(await bench.alice.apply(block(0, 1), bytes(n % 4 for n in range(200))))
        answers.append(await bench.alice.send((block(0, 0), "alice-q9"), (block(0, 1), "alice-q0")))
        answers.append(await bench.bob.receive(block(0, 0), "bob-q9"))
        answers.append(await bench.bob.receive(block(0, 1), "bob-q0"))
        for half in (0, 1):
            request = GatherRequest(into=block(2, half))
            request.picks.add(block=block(0, half), photons=pack(range(199, 19, -1)))
            answers.append(await bench.bob.act(request))
        answers.append(await bench.bob.bell_measure(block(2, 0), block(2, 1)))
        states = bytes(n % 6 for n in range(60))
        chosen = CreateRequest(session=7, number=3, count=60, state=PREPARED, states=states)
        answers.append(await bench.bob.act(chosen))
        bases = bytes((0, 1, 2, 255)[n % 4] for n in range(60))
        resend = ResendRequest(block=block(3), bases=bases)
        answers.append(await bench.bob.act(resend))
        answers.append(await bench.bob.measure(block(3), MeasureRequest.X))
        tilted = ApplyRequest(block=block(1), gates=[Gate(name=Gate.RX, angle_rad=0.4)])
        answers.append(await bench.alice.act(tilted))
        answers += [await bench.alice.measure(block(1, half)) for half in (0, 1)]
        if config.backend == "dense":
            answers += await each_turned(bench)
        assert (await bench.runner.status()).live_qubits == 0
    return answers, log.read_text()


async def each_turned(bench: Bench) -> list[Feedback]:
    """Turn photons by angles of their own, and measure them."""
    await bench.alice.create(100, number=4)
    turn = Gate(name=Gate.RY, angles_rad=[0.06 * n for n in range(100)])
    tilted = ApplyRequest(block=block(4), gates=[turn])
    answers = [await bench.alice.act(tilted)]
    return answers + [await bench.alice.measure(block(4, half)) for half in (0, 1)]


@pytest.mark.parametrize("backend", sorted(BACKENDS))
def test_the_dispatcher_gives_the_same_over_the_socket(tmp_path: Path, backend: str) -> None:
    here = uvloop.run(transmission(tmp_path / "here", backend=backend))
    with serving_in(tmp_path) as socket:
        there = uvloop.run(transmission(tmp_path / "there", backend=backend, sabot=socket))
    assert there == here


def test_a_dispatcher_without_its_server_says_so_in_one_line(tmp_path: Path) -> None:
    config = configuration(tmp_path, sabot=str(tmp_path / "absent.sock"))
    config.write(tmp_path / "dispatcher.json")
    command = [sys.executable, "-m", "dispatcher", "--config", str(tmp_path / "dispatcher.json")]
    done = forked_python.run(command, SOON_S)
    assert done.returncode == 1
    assert "absent.sock" in done.stderr
    assert "start it with python -m dispatcher.sabot --socket" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_server_that_dies_is_an_error_and_not_a_result(tmp_path: Path) -> None:
    with serving_in(tmp_path) as socket:
        remote = RemoteSabot(socket, "chp")
        register = remote.zeros(3)
    with pytest.raises(SabotUnreachable, match=r"s\.sock"):
        remote.gate("H", register)


def test_a_refused_request_names_the_value_and_changes_nothing(tmp_path: Path) -> None:
    with stub_of(tmp_path) as stub:
        before = prepare(stub)
        for method, request, code, text in REFUSED:
            with pytest.raises(grpc.RpcError) as raised:
                getattr(stub, method)(request, timeout=SOON_S)
            assert (raised.value.code(), text in str(raised.value.details())) == (code, True), (
                request
            )
            assert status(stub) == before
        # The pair is still one.
        answers = [stub.Measure(measure(register=n), timeout=SOON_S) for n in (1, 2)]
        assert answers[0].outcomes == answers[1].outcomes


def test_bytes_that_are_no_message_are_refused(tmp_path: Path) -> None:
    with (
        serving_in(tmp_path) as socket,
        grpc.insecure_channel(f"unix:{socket}") as channel,
    ):
        for method in ("Begin", "Create", "Apply", "Measure", "Dump"):
            send = channel.unary_unary(f"/qmn.sabot.Sabot/{method}", None, None)
            with pytest.raises(grpc.RpcError) as raised:
                send(b"\xff" * 50, timeout=SOON_S)
            assert raised.value.code() == Code.INTERNAL
        assert RemoteSabot(socket, "chp").zeros(1).size == 1


def test_workspaces_are_limited_and_apart(tmp_path: Path) -> None:
    with stub_of(tmp_path) as stub:
        prepare(stub)
        begin = messages.BeginRequest(backend="chp")
        numbers = [stub.Begin(begin).workspace for _ in range(MAX_WORKSPACES - 1)]
        with pytest.raises(grpc.RpcError, match="16 workspaces are in use"):
            stub.Begin(begin)
        with pytest.raises(grpc.RpcError, match="no register 1"):
            stub.Measure(measure(workspace=numbers[0]))
        stub.End(messages.RegisterRequest(workspace=1))
        with pytest.raises(grpc.RpcError, match="no workspace 1"):
            status(stub)
        stub.Begin(begin)


def test_states_are_dumped_as_stabilizers_or_amplitudes(tmp_path: Path) -> None:
    with stub_of(tmp_path) as stub:
        prepare(stub)
        flips = messages.ApplyRequest(workspace=1, register=1, paulis=bytes((0, 1, 2, 3)))
        stub.Apply(flips)
        dump = stub.Dump(messages.DumpRequest(workspace=1, registers=[1, 2], members=4))
        assert dump.backend == "chp"
        assert [tuple(state.registers) for state in dump.states] == [(1, 2)] * 4
        signs = [set(state.stabilizers.split("\n")) for state in dump.states]
        assert signs == [
            {"+XX", "+ZZ"},
            {"+XX", "-ZZ"},
            {"-XX", "+ZZ"},
            {"-XX", "-ZZ"},
        ]
        tilt = messages.Gate(name="RY", angle_rad=2 * 0.3)
        stub.Apply(messages.ApplyRequest(workspace=1, register=4, gates=[tilt]))
        (state,) = stub.Dump(messages.DumpRequest(workspace=1, registers=[4], members=1)).states
        assert (state.backend, state.stabilizers) == ("dense", "")
        assert state.real == pytest.approx([np.cos(0.3), np.sin(0.3)])
        assert state.imaginary == pytest.approx([0, 0])


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_the_program_serves_its_owner_alone_and_ends_cleanly(tmp_path: Path, number: int) -> None:
    socket = tmp_path / "s.sock"
    command = [sys.executable, "-m", "dispatcher.sabot", "--socket", str(socket)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as program:
        assert program.stdout
        assert program.stdout.readline() == b"ready\n"
        assert stat.S_IMODE(socket.stat().st_mode) == 0o600
        with RemoteSabot(str(socket), "chp") as remote:
            assert remote.zeros(2).size == 2
        os.kill(program.pid, number)
        assert program.wait(SOON_S) == 0
        assert program.stderr
        assert program.stderr.read() == b""
    assert not socket.exists()


@pytest.mark.parametrize("name", ["s" * 100, "absent/s.sock"])
def test_a_socket_that_cannot_be_is_named(tmp_path: Path, name: str) -> None:
    command = [sys.executable, "-m", "dispatcher.sabot", "--socket", str(tmp_path / name)]
    done = forked_python.run(command, SOON_S)
    assert done.returncode == 1
    assert str(tmp_path / name) in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_dump_says_where_gathered_qubits_are(tmp_path: Path) -> None:
    with stub_of(tmp_path) as stub:
        prepare(stub)
        stub.Gather(gather((2, [2, 0])))  # half of the pairs with register 1
        dump = stub.Dump(messages.DumpRequest(workspace=1, registers=[5], members=4))
    states = sorted((list(state.registers), list(state.positions)) for state in dump.states)
    assert states == [([1, 5], [0, 1]), ([1, 5], [2, 0])]
    assert sorted(state.position for state in dump.states) == [0, 1]
