"""Key managers back to back: the same keys for a master and its slaves, once, and nobody else."""

import os
from collections.abc import Awaitable, Callable
from pathlib import Path
from uuid import UUID, uuid4

import pytest

from applications.ip_over_light.format import PACKETS_PORT, RETURNED_PACKETS_PORT
from applications.keys.config import KEY_LINK_PORTS, KeyManagerConfig, manager_name
from applications.keys.delivery import KeyDelivery
from applications.keys.key_assignment import Assignment
from applications.keys.key_delivery import DeliveredKey, KeyRequest
from applications.keys.refusals import NOT_FOUND, Allowance, Refused, unavailable
from applications.keys.waiting import WaitingKeys
from applications.qkd.key_files import KeyStoreError
from applications.qkd.key_store import StoredKey
from applications.timeouts import FETCH_TIMEOUT_S
from hosts import network_loop

HOSTS = {"alice": "10.0.0.1", "bob": "10.0.0.2", "carol": "10.0.0.3"}
SAES = {"a": "alice", "a2": "alice", "b": "bob", "b2": "bob", "c": "carol"}
STORED = 8  # keys of each direction
MOST = 32  # that wait, in a test of that


@pytest.fixture(autouse=True)
def _nothing_waits_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what only a power cut would show; the tests of the store have it."""
    monkeypatch.setattr(os, "fsync", lambda _file: None)


class Managers:
    """Key managers whose assignments go from one to the other as bytes."""

    def __init__(self, folder: Path) -> None:
        folder.chmod(0o700)
        self.reports: list[tuple[str, Assignment]] = []
        self.silent = False
        self.of = {host: self._manager(folder, host) for host in HOSTS}
        for one in HOSTS:
            for other in HOSTS:
                if one < other:
                    self.fill(one, other)

    def fill(self, one: str, other: str) -> None:
        """Put the same keys into the stores of two hosts, half of them first at either."""
        for first in (one, other):
            keys = [StoredKey(uuid4(), os.urandom(32)) for _ in range(STORED)]
            self.of[one].stores[other].put_all(keys, first=first == one)
            self.of[other].stores[one].put_all(keys, first=first == other)

    def _manager(self, folder: Path, host: str) -> KeyDelivery:
        async def tell(to: str, assignment: Assignment) -> None:
            if self.silent:
                raise unavailable("nobody answers")
            heard = Assignment.decode(assignment.encode())
            self.reports.append((to, heard))
            await self.of[to].accept(manager_name(host), heard)

        config = KeyManagerConfig(
            host=host,
            address=HOSTS[host],
            keys=str(folder / host),
            hosts=HOSTS,
            saes=SAES,
            certificate="",
            private_key="",
            authority="",
            stack="",
        )

        async def send(to: str, body: bytes) -> None:
            await self.of[to].accept_relay(manager_name(host), body)

        return KeyDelivery(config, tell, send)


Scene = Callable[[Managers], Awaitable[None]]


def play(folder: Path, scene: Scene) -> None:
    async def whole() -> None:
        await scene(Managers(folder))

    network_loop.run(whole())


def ids(keys: list[DeliveredKey]) -> list[UUID]:
    return [key.key_id for key in keys]


@pytest.mark.parametrize(("number", "size"), [(1, 8), (1, 256), (2, 264), (1, 2048), (8, 256)])
def test_master_and_slave_get_the_same_keys(tmp_path: Path, number: int, size: int) -> None:
    async def scene(managers: Managers) -> None:
        keys = await managers.of["alice"].get_keys("a", "b", KeyRequest(number, size))
        assert [len(key.key) for key in keys] == [size // 8] * number
        assert managers.of["bob"].fetch("b", "a", ids(keys)[::-1]) == keys[::-1]
        left = STORED - number * -(-size // 256)
        assert (await managers.of["alice"].status("a", "b")).stored_key_count == left
        assert managers.of["bob"].stores["alice"].theirs == left
        assert (await managers.of["bob"].status("b", "a")).stored_key_count == STORED
        # No key went by the network where both ends have stored it.
        assert [key.masked for _to, report in managers.reports for key in report.keys] == [
            b""
        ] * number

    play(tmp_path, scene)


def test_a_key_goes_to_each_once(tmp_path: Path) -> None:
    async def scene(managers: Managers) -> None:
        (key,) = await managers.of["alice"].get_keys("a", "b", KeyRequest())
        managers.of["bob"].fetch("b", "a", [key.key_id])
        with pytest.raises(Refused, match=NOT_FOUND) as refused:
            managers.of["bob"].fetch("b", "a", [key.key_id])
        assert refused.value.status == 400
        others = [await managers.of["alice"].get_keys("a", "b", KeyRequest()) for _ in range(3)]
        assert len({key.key, *(each[0].key for each in others)}) == 4

    play(tmp_path, scene)


def test_an_application_sees_only_its_own(tmp_path: Path) -> None:
    async def scene(managers: Managers) -> None:
        (key,) = await managers.of["alice"].get_keys("a", "b", KeyRequest())
        bob = managers.of["bob"]
        for caller, master, status in (
            ("b2", "a", 401),  # is not named as slave
            ("a", "a", 401),  # is no application of bob's
            ("kme-alice", "a", 401),
            ("b", "a2", 400),  # not this master's
            ("b", "nobody", 400),
        ):
            with pytest.raises(Refused) as refused:
                bob.fetch(caller, master, [key.key_id])
            assert refused.value.status == status, (caller, master)
        with pytest.raises(Refused):  # one of them is not there: none goes
            bob.fetch("b", "a", [key.key_id, uuid4()])
        assert bob.fetch("b", "a", [key.key_id]) == [key]
        for caller in ("b", "nobody"):
            with pytest.raises(Refused) as refused:
                await managers.of["alice"].get_keys(caller, "b", KeyRequest())
            assert refused.value.status == 401
            with pytest.raises(Refused):
                await managers.of["alice"].status(caller, "b")

    play(tmp_path, scene)


def test_slaves_of_several_hosts_get_the_same_keys(tmp_path: Path) -> None:
    async def scene(managers: Managers) -> None:
        request = KeyRequest(2, 264, ("c", "a2", "b2"))
        keys = await managers.of["alice"].get_keys("a", "b", request)
        for slave, host in (("b", "bob"), ("b2", "bob"), ("c", "carol"), ("a2", "alice")):
            assert managers.of[host].fetch(slave, "a", ids(keys)) == keys
        masked = [
            key.masked for to, report in managers.reports if to == "carol" for key in report.keys
        ]
        assert len(masked) == 2
        assert not {key.key for key in keys} & set(masked)
        assert managers.of["carol"].stores["alice"].theirs == STORED - 4

    play(tmp_path, scene)


def test_applications_of_one_host_share_keys_without_light(tmp_path: Path) -> None:
    async def scene(managers: Managers) -> None:
        keys = await managers.of["alice"].get_keys("a", "a2", KeyRequest(2, 128))
        assert managers.of["alice"].fetch("a2", "a", ids(keys)) == keys
        assert managers.reports == []
        assert managers.of["alice"].stores["bob"].mine == STORED

    play(tmp_path, scene)


@pytest.mark.parametrize(
    ("slave", "request_", "status", "message"),
    [
        ("b", KeyRequest(1, 257), 400, "size shall be a multiple of 8"),
        ("b", KeyRequest(1, 1 << 15), 400, "size shall be 8 to 16384 bits"),
        ("b", KeyRequest(1, 1 << 14), 503, "keys of 256 bits are left"),  # so long it may be
        ("b", KeyRequest(129), 400, "number shall be 128 at most"),
        ("b", KeyRequest(STORED + 1), 503, "8 keys of 256 bits are left"),
        ("b", KeyRequest(additional=("b",)), 400, "named twice"),
        ("nobody", KeyRequest(), 400, "nobody"),
        (
            "b",
            KeyRequest(mandatory=("abc",)),
            400,
            "not all extension_mandatory parameters are supported",
        ),
    ],
)
def test_what_cannot_be_asked_takes_no_key(
    tmp_path: Path, slave: str, request_: KeyRequest, status: int, message: str
) -> None:
    async def scene(managers: Managers) -> None:
        with pytest.raises(Refused, match=message) as refused:
            await managers.of["alice"].get_keys("a", slave, request_)
        assert refused.value.status == status
        assert managers.of["alice"].stores["bob"].mine == STORED

    play(tmp_path, scene)


def test_a_manager_takes_assignments_for_its_own_from_the_masters_only(tmp_path: Path) -> None:
    async def scene(managers: Managers) -> None:
        for manager, master, slave in (
            ("kme-carol", "a", "b"),  # who is not a's manager
            ("a", "a", "b"),  # is no manager
            ("kme-alice", "a", "c"),  # which is not bob's
            ("kme-bob", "b", "b2"),  # itself
        ):
            with pytest.raises(Refused) as refused:
                await managers.of["bob"].accept(manager, Assignment(master, (slave,), ()))
            assert refused.value.status == 401

    play(tmp_path, scene)


def test_what_a_manager_has_not_taken_is_thrown_away_with_the_next(tmp_path: Path) -> None:
    async def scene(managers: Managers) -> None:
        managers.silent = True
        with pytest.raises(Refused, match="nobody answers"):
            await managers.of["alice"].get_keys("a", "b", KeyRequest(3))
        managers.silent = False
        keys = await managers.of["alice"].get_keys("a", "b", KeyRequest(2))
        assert managers.of["bob"].fetch("b", "a", ids(keys)) == keys
        left = managers.of["alice"].stores["bob"].mine, managers.of["bob"].stores["alice"].theirs
        assert left == (STORED - 5, STORED - 5)

    play(tmp_path, scene)


def test_links_of_each_protocol_have_a_port_that_nothing_else_of_a_host_listens_on() -> None:
    ports = [*KEY_LINK_PORTS.values(), PACKETS_PORT, RETURNED_PACKETS_PORT]
    assert len(set(ports)) == len(ports)


def test_no_key_goes_out_while_they_are_withheld(tmp_path: Path) -> None:
    async def scene(managers: Managers) -> None:
        alice = managers.of["alice"]
        alice.withheld["bob"] = "QBER 0.25"
        with pytest.raises(Refused, match=r"QBER 0.25") as refused:
            await alice.get_keys("a", "b", KeyRequest())
        assert refused.value.status == 503
        assert await alice.get_keys("a", "c", KeyRequest())
        del alice.withheld["bob"]
        assert await alice.get_keys("a", "b", KeyRequest())

    play(tmp_path, scene)


def test_an_allowance_fills_at_its_rate() -> None:
    now = 0.0
    allowance = Allowance(2.0, 10, lambda: now)
    allowance.take("a", 10)
    allowance.take("b", 10)
    with pytest.raises(Refused, match=r"2 keys a second: ask again in 0.5 s"):
        allowance.take("a", 1)
    now = 2.0
    allowance.take("a", 4)
    with pytest.raises(Refused):
        allowance.take("a", 1)
    now = 100.0
    allowance.take("a", 10)  # it holds no more
    with pytest.raises(Refused):
        allowance.take("a", 1)


def test_keys_that_wait_are_bounded_and_not_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("applications.keys.waiting.MOST_WAITING", MOST)
    now = 0.0
    waiting = WaitingKeys(lambda: now, tmp_path)
    keys = [DeliveredKey(uuid4(), b"k") for _ in range(MOST)]
    waiting.add("a", ["b"], keys)
    more = [DeliveredKey(uuid4(), b"k")]
    with pytest.raises(Refused, match="32 keys to fetch first"):
        waiting.add("a", ["b"], more)
    waiting.fetch("b", "a", [keys[0].key_id])
    waiting.add("a", ["b"], more)
    now = FETCH_TIMEOUT_S + 1
    waiting.require_capacity(["b"], MOST)
    with pytest.raises(Refused, match=NOT_FOUND):
        waiting.fetch("b", "a", [keys[1].key_id])


def test_a_key_id_is_assigned_once(tmp_path: Path) -> None:
    waiting = WaitingKeys(lambda: 0.0, tmp_path)
    key = DeliveredKey(uuid4(), b"k")
    waiting.add("a", ["b"], [key])
    with pytest.raises(Refused, match="assigned already"):
        waiting.add("a", ["b"], [DeliveredKey(key.key_id, b"other")])
    assert waiting.fetch("b", "a", [key.key_id]) == [key]


def test_keys_that_wait_survive_the_manager_and_go_out_once(tmp_path: Path) -> None:
    waiting = WaitingKeys(lambda: 0.0, tmp_path)
    keys = [DeliveredKey(uuid4(), os.urandom(33)) for _ in range(3)]
    waiting.add("a", ["b", "b2"], keys)
    assert waiting.fetch("b", "a", ids(keys[:2])) == keys[:2]
    assert waiting.fetch("b2", "a", ids(keys[:1])) == keys[:1]
    again = WaitingKeys(lambda: 0.0, tmp_path)
    with pytest.raises(Refused, match=NOT_FOUND):  # b has had it
        again.fetch("b", "a", ids(keys[1:]))
    assert again.fetch("b", "a", ids(keys[2:])) == keys[2:]
    assert again.fetch("b2", "a", ids(keys[1:])) == keys[1:]
    assert list(tmp_path.iterdir()) == []


def test_files_of_keys_that_wait_are_private_and_what_is_unfinished_goes(tmp_path: Path) -> None:
    waiting = WaitingKeys(lambda: 0.0, tmp_path / "assigned")
    key = DeliveredKey(uuid4(), b"k" * 32)
    waiting.add("a", ["b"], [key])
    (file,) = (tmp_path / "assigned").iterdir()
    assert (file.stat().st_mode & 0o777, file.parent.stat().st_mode & 0o777) == (0o600, 0o700)
    cut_short = file.with_name(f"{uuid4()}.new")
    cut_short.write_text("{")
    again = WaitingKeys(lambda: 0.0, tmp_path / "assigned")
    assert not cut_short.exists()
    assert again.fetch("b", "a", [key.key_id]) == [key]
    file.write_text("{}")
    with pytest.raises(KeyStoreError, match="is not an assigned key"):
        WaitingKeys(lambda: 0.0, tmp_path / "assigned")
