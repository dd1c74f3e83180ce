"""qmn replay, as a user types it."""

import asyncio
import re
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import forked_python
import pytest
from limits import SOON_S

from dispatcher.build import open_layer
from dispatcher.clock import NetworkClock
from dispatcher.server.server import build_service
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import BlockId, CreateRequest, Launch, MeasureRequest, SendRequest
from wire.dispatcher_record import MAGIC
from wire.parameters.physics import Device, PairSource


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    """Return the folder of a run of a small network."""
    return recorded_run(tmp_path)


IDEAL = Device()


def recorded_run(
    tmp_path: Path, alice: Device = IDEAL, record_bytes: float = 1e9, **optics: str
) -> Path:
    """Have a small network do something; return the folder of the run."""
    fiber = Fiber(FiberEnd("alice", "a0"), FiberEnd("bob", "b0"), depolarizing=0.2, **optics)  # type: ignore[arg-type]
    config = DispatcherConfig(
        listen="",
        socket="",
        seed=4,
        tokens={"alice": "token"},
        fibers=[fiber],
        switches=[],
        devices={"alice": alice},
        event_log=str(tmp_path / "quantum.log"),
        record=str(tmp_path / "dispatcher.record"),
        file_gib=record_bytes / 2**30,
    )

    async def act() -> None:
        with ExitStack() as stack:
            log = stack.enter_context(Path(config.event_log).open("a"))
            layer = open_layer(config, NetworkClock(), log, stack)
            service = build_service(config, layer, lambda error: None)
            block = BlockId(session=1)
            create = CreateRequest(session=1, count=20)
            await service.change("alice", "create", create)
            send = SendRequest(launches=[Launch(block=block, port="a0")], rate_hz=1000)
            await service.change("alice", "send", send)
            await service.table.transport.landed()
            half = BlockId(session=1, half=1)
            await service.change("alice", "measure", MeasureRequest(block=half))

    asyncio.run(act())
    return tmp_path


def replay(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run the command."""
    command = [sys.executable, "-m", "qmn", "replay", str(folder), *options]
    return forked_python.run(command, SOON_S)


def test_a_run_is_identical(run_folder: Path) -> None:
    done = replay(run_folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "identical: 4 events of 3 requests\n"


def test_the_first_line_that_differs_is_shown(run_folder: Path) -> None:
    log = run_folder / "quantum.log"
    lines = log.read_text().splitlines(keepends=True)
    log.write_text("".join([*lines[:2], lines[2].replace("arrive", "vanish"), lines[3]]))
    done = replay(run_folder)
    assert done.returncode == 1
    first, recorded, replayed = done.stdout.splitlines()
    assert first == "different from line 3"
    assert recorded == f"  recorded: {lines[2].replace('arrive', 'vanish').rstrip()}"
    assert replayed == f"  replayed: {lines[2].rstrip()}"


@pytest.mark.parametrize("change", [lambda text: text + "more\n", lambda text: text[:-10]])
def test_a_log_of_another_length_differs(run_folder: Path, change: object) -> None:
    assert callable(change)
    log = run_folder / "quantum.log"
    log.write_text(change(log.read_text()))
    assert replay(run_folder).returncode == 1


OWN_MODEL = """
from pathlib import Path
from dispatcher.fiber.noise import Effect

Path("PROOF").touch()

class Mine:
    def effect(self, passage):
        return Effect()
"""


@pytest.mark.parametrize("of", ["a fibre", "a source"])
def test_code_that_a_record_names_is_run_only_if_that_is_allowed(tmp_path: Path, of: str) -> None:
    model, proof = tmp_path / "model.py", tmp_path / "proof"
    model.write_text(OWN_MODEL.replace("PROOF", str(proof)))
    noise = f"{model}:Mine"
    if of == "a fibre":
        run = recorded_run(tmp_path, noise=noise)
    else:
        run = recorded_run(tmp_path, Device(source=PairSource(noise=noise)))
    proof.unlink()
    done = replay(run)
    assert done.returncode == 2
    assert f"names code, which would be run: {model}:Mine" in done.stderr
    assert "--allow-code" in done.stderr
    assert not proof.exists()
    assert replay(run, "--allow-code").stdout == "identical: 4 events of 3 requests\n"
    assert proof.exists()


def test_a_folder_without_a_record_is_named(tmp_path: Path) -> None:
    done = replay(tmp_path)
    assert done.returncode == 2
    assert f"cannot read {tmp_path / 'dispatcher.record'}" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_record_that_became_too_long_is_replayed_as_far_as_it_goes(tmp_path: Path) -> None:
    """Wherever its bound is, what it has is whole."""
    folders = [tmp_path / f"{number}" for number in range(5)]
    folders[0].mkdir()
    record = (recorded_run(folders[0]) / "dispatcher.record").read_bytes()
    begin = len(MAGIC) + 4 + int.from_bytes(record[len(MAGIC) :][:4])  # MAGIC and the header
    reports = []
    for number, folder in enumerate(folders[1:], 1):
        folder.mkdir()
        most = begin + (len(record) - begin) * number // 5
        recorded_run(folder, record_bytes=most)
        done = replay(folder)
        assert (done.returncode, done.stderr) == (0, "")
        reports.append(
            re.fullmatch(r"identical: (\d) events of (\d) requests\n(.*)\n", done.stdout)
        )
    assert all(each and "has become too long (--file-gib)" in each[3] for each in reports)
    counts = [(int(each[1]), int(each[2])) for each in reports if each]
    assert counts == sorted(counts)
    assert counts[0] == (0, 0)
    assert counts[-1] > (0, 0)


def test_a_record_that_was_cut_off_is_said_to_be_so(run_folder: Path) -> None:
    record = run_folder / "dispatcher.record"
    record.write_bytes(record.read_bytes()[:-1])
    done = replay(run_folder)
    assert done.returncode == 2
    assert "ends in the middle of an entry" in done.stderr
    assert done.stderr.count("\n") == 1
