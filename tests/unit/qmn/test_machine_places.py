"""The placing of hosts on machines."""

from functools import partial
from pathlib import Path

import pytest
from distributed import Client, LocalCluster

from qmn.machines import workers
from qmn.machines.options import MachineOptions, machines_of
from qmn.machines.workers import found_workers, places
from qmn.options import BadInput
from topologies.system.machines.tunnel import TUNNELS
from topologies.system.processes.programs import NetworkError

HOSTS, WORKERS = ("alice", "bob", "charlie", "dave"), ("m2", "m3")


def test_hosts_that_are_placed_go_where_they_are_placed_and_others_stay() -> None:
    assert places(("bob=m2", "alice=m1", "dave=m3"), HOSTS, WORKERS) == {"bob": "m2", "dave": "m3"}


def test_hosts_go_to_the_machines_in_turn_if_none_is_placed() -> None:
    assert places((), HOSTS, WORKERS) == {"bob": "m2", "charlie": "m3"}


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("bob", "write HOST=MACHINE"),
        ("eve=m2", "no host eve: choose one of alice, bob, charlie, dave"),
        ("alcie=m2", "no host alcie: did you mean alice?"),
        ("bob=x4", "no machine x4: choose one of m1, m2, m3"),
    ],
)
def test_places_that_there_are_not_are_refused(text: str, error: str) -> None:
    with pytest.raises(BadInput, match=error):
        places((text,), HOSTS, WORKERS)


def test_a_host_is_placed_once() -> None:
    with pytest.raises(BadInput, match="once a host"):
        places(("bob=m2", "bob=m3"), HOSTS, WORKERS)


def test_one_machine_needs_no_other() -> None:
    nobody = partial(pytest.fail, "there is no scheduler to look for")
    with machines_of(MachineOptions(), HOSTS, None, nobody) as machines:
        assert machines == {}


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("place", MachineOptions(place=("bob=m2",))),
        ("scheduler", MachineOptions(scheduler="tcp://127.0.0.1:1")),
        ("tunnels", MachineOptions(tunnels=TUNNELS[0])),
    ],
)
def test_one_machine_takes_no_option_of_several(name: str, options: MachineOptions) -> None:
    nobody = partial(pytest.fail, "there is no scheduler to look for")
    with (
        pytest.raises(BadInput, match=f"--{name} has no effect on one machine"),
        machines_of(options, HOSTS, None, nobody),
    ):
        pytest.fail("the network would start")


def test_as_many_workers_as_are_wanted_are_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "WORKERS_TIMEOUT_S", 0.2)
    with (
        LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=False,
            protocol="tcp",
            host="127.0.0.1",
            dashboard_address=None,
            local_directory=tmp_path,
        ) as there,
        Client(there) as client,
    ):
        client.wait_for_workers(2)
        for least in (1, 2):
            found = found_workers(client, least)
            assert sorted(found) == list(found) == ["0", "1"]
            assert all(address.startswith("tcp://127.0.0.1:") for address in found.values())
        with pytest.raises(NetworkError, match=r"--machines 4: .* there are 2 workers \(0, 1\)"):
            found_workers(client, 3)
