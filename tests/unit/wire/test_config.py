"""Configuration files: what the runner writes is what a program reads."""

from pathlib import Path

import pytest

from wire.config import (
    BadConfig,
    ControllerConfig,
    DispatcherConfig,
    EntranceConfig,
    Fiber,
    FiberEnd,
    HostConfig,
    QuantumSwitch,
)
from wire.credentials import Credentials
from wire.parameters.physics import Detectors, Device


def test_a_written_file_reads_back_the_same_and_only_its_owner_may_read_it(tmp_path: Path) -> None:
    config = DispatcherConfig(
        listen="10.0.0.4:50051",
        socket="/run/x.sock",
        seed=5,
        tokens={"alice": "secret"},
        fibers=[
            Fiber(
                FiberEnd("alice", "alice-q0"),
                FiberEnd("q1", "2"),
                length_km=0.5,
                depolarizing=0.01,
                noise="/tmp/flicker.py:Flicker",
                noise_parameters={"p": 0.1},
            )
        ],
        switches=[QuantumSwitch("q1", rotation=2)],
        devices={"alice": Device(detectors=Detectors(efficiency=0.8))},
    )
    path = tmp_path / "dispatcher.json"
    config.write(path)
    assert DispatcherConfig.read(path) == config
    assert path.stat().st_mode & 0o777 == 0o600


def test_credentials_read_back_as_they_were_written(tmp_path: Path) -> None:
    own = Credentials("/run/ca.pem", "/run/c0.pem", "/run/c0.key")
    config = EntranceConfig(["198.18.1.1:6653"], "127.0.0.1:6653", own, {"q1": 1})
    path = tmp_path / "c0-tls.json"
    config.write(path)
    assert EntranceConfig.read(path) == config


@pytest.mark.parametrize("text", ["", "{", "[]", '{"name": "alice"}', '{"unknown": 1}'])
def test_a_file_of_another_kind_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "host.json"
    path.write_text(text)
    with pytest.raises(BadConfig, match=r"host\.json is not a HostConfig"):
        HostConfig.read(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadConfig, match="nowhere"):
        HostConfig.read(tmp_path / "nowhere")


def test_an_unknown_backend_is_named(tmp_path: Path) -> None:
    path = tmp_path / "dispatcher.json"
    path.write_text(
        '{"listen": "127.0.0.1:1", "socket": "d.sock", "seed": 1, "tokens": {},'
        ' "fibers": [], "switches": [], "backend": "chip"}'
    )
    with pytest.raises(BadConfig, match=r"backend 'chip': did you mean chp\?"):
        DispatcherConfig.read(path)


def test_an_unknown_policy_of_contention_is_named(tmp_path: Path) -> None:
    path = tmp_path / "controller.json"
    path.write_text('{"listen": "127.0.0.1:1", "framework": "ryu", "contention": "quue"}')
    with pytest.raises(BadConfig, match=r"contention 'quue': did you mean queue\?"):
        ControllerConfig.read(path)


FIBER = '{"a": {"node": "alice", "port": "alice-q0"}, "b": {"node": "q1", "port": "2"}, %s}'


@pytest.mark.parametrize(
    ("fiber", "words"),
    [
        ('"length_km": "1"', r"it\.fibers\[0\]\.length_km: '1' is not number$"),
        ('"length_km": true', r"it\.fibers\[0\]\.length_km: True is not number$"),
        ('"lenght_km": 1', r"it\.fibers\[0\] has no lenght_km: did you mean length_km\?$"),
        (f'"channels": {1 << 2000}', r"it\.fibers\[0\]\.channels: \d+\.\.\.\d+ is not integer$"),
        ('"noise": "\\ud800"', r"it\.fibers\[0\]\.noise: .* is not string$"),
        (f'"noise_parameters": {"[" * 100_000}', "maximum recursion depth exceeded"),
    ],
    ids=["text", "boolean", "slip", "huge", "half a character", "deep"],
)
def test_a_wrong_value_in_a_fibre_is_named_by_its_place(
    tmp_path: Path, fiber: str, words: str
) -> None:
    path = tmp_path / "dispatcher.json"
    path.write_text(
        '{"listen": "127.0.0.1:1", "socket": "d.sock", "seed": 1, "tokens": {},'
        f' "switches": [], "fibers": [{FIBER % fiber}]}}'
    )
    with pytest.raises(BadConfig, match=rf"dispatcher\.json is not a DispatcherConfig: .*{words}"):
        DispatcherConfig.read(path)
