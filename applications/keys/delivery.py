"""Deliveries of a key manager, and to whom: ETSI GS QKD 014 without the HTTP.

    SAE a -- enc_keys --> KME of a -- assignment --> KME of b
          <-- id, key ---                              |
          --- id, by whatever way a and b have --> SAE b -- dec_keys --> the same key

Keys that this end hands out first become the master's; the slave's manager removes the same ones
before the master gets any. A slave of a third host gets the key masked with keys shared with that
host. To a host without such keys they are relayed (relaying.py), by whom the controller chooses.
Applications of one manager get keys that it draws: there is no light between them.
"""

import asyncio
import os
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Protocol
from uuid import UUID, uuid4

from applications.keys.config import KeyManagerConfig, manager_name
from applications.keys.key_assignment import MAX_BITS, AssignedKey, Assignment
from applications.keys.key_delivery import MAX_IDS, MAX_NAMES, DeliveredKey, KeyRequest, Status
from applications.keys.refusals import (
    NOT_MULTIPLE,
    NOT_SUPPORTED,
    Allowance,
    Refused,
    bad_request,
    unauthorized,
    unavailable,
)
from applications.keys.relaying import Relaying, Send, stored_for
from applications.keys.route_messages import KeyRoute
from applications.keys.stored_keys import StoredKeys
from applications.keys.waiting import WaitingKeys
from applications.qkd.key_store import KEY_BITS, StoredKey
from applications.qkd.keyring import CAPACITY
from hosts.network_loop import now_s

ASSIGNED = ".assigned"  # folder of keys that wait for applications; no host is called so
MIN_BITS = 8
BURST = MAX_IDS * MAX_BITS // KEY_BITS  # the largest request

Tell = Callable[[str, Assignment], Awaitable[None]]  # a host's key manager; raises Refused


class Router(Protocol):
    """Finds key managers by which keys can go to other hosts."""

    async def ask(self, host: str, stored: int, master: str, slave: str) -> KeyRoute:
        """Return the manager by which stored keys can go to a host; raise Refused if none."""

    async def register(self, host: str, master: str, slave: str) -> None:
        """Note an application whose keys need no relay."""


class KeyDelivery:
    def __init__(self, config: KeyManagerConfig, tell: Tell, send: Send) -> None:
        self._config, self._tell = config, tell
        self._stored = StoredKeys(config)
        self.stores, self.withheld = self._stored.stores, self._stored.withheld
        self._waiting = WaitingKeys(now_s, Path(config.keys) / ASSIGNED)
        self._allowance = Allowance(config.keys_per_s, BURST, now_s)
        self._linked = {link.peer for link in config.links}
        self._relaying = Relaying(config, self._stored, send, self._waiting.add)
        self._registered: dict[tuple[str, str], asyncio.Task[None]] = {}
        self.router: Router | None = None  # None: there is no controller to ask
        self.withholds = config.withhold  # whether too many errors close the way to a host

    async def status(self, caller: str, slave: str) -> Status:
        """Return the status of keys for a master and a slave; raise Refused for others."""
        self._require_own(caller)
        target = self._host_of(slave)
        count = await self._available(caller, slave, target)
        return Status(
            source_KME_ID=manager_name(self._config.host),
            target_KME_ID=manager_name(target),
            master_SAE_ID=caller,
            slave_SAE_ID=slave,
            key_size=KEY_BITS,
            stored_key_count=count,
            max_key_count=CAPACITY,
            max_key_per_request=MAX_IDS,
            max_key_size=MAX_BITS,
            min_key_size=MIN_BITS,
            max_SAE_ID_count=MAX_NAMES,
        )

    async def get_keys(self, caller: str, slave: str, request: KeyRequest) -> list[DeliveredKey]:
        """Return new keys of a master and its slaves, who can fetch them; or raise Refused."""
        self._require_own(caller)
        slaves = self._grouped([slave, *request.additional])
        size = self._size(request)
        stored_each = -(-size // KEY_BITS)
        count = request.number * stored_each
        self._require_served(slaves)
        self._waiting.require_capacity(slaves.get(self._config.host, []), request.number)
        remote = [host for host in slaves if host != self._config.host]
        relayed = {
            host: await self._route(caller, slaves[host][0], host, request.number, size)
            for host in remote
            if self._is_relayed(host)
        }
        direct = [host for host in remote if host not in relayed]
        self._require_stored(direct, count)
        self._allowance.take(caller, count * max(1, len(remote)))
        ids = [uuid4() for _ in range(request.number)]
        stored = {host: await self._taken(host, count, stored_each) for host in direct}
        keys = self._made(ids, size // 8, stored.get(direct[0]) if direct else None)
        for number, host in enumerate(direct):
            assigned = [
                _assigned(key, each, masked=number > 0)
                for key, each in zip(keys, stored[host], strict=True)
            ]
            await self._assign(host, caller, slaves[host], assigned)
            self._register(host, caller, slaves[host][0])
        for host, route in relayed.items():
            await self._relaying.send(route, caller, slaves[host], keys)
        if reader := slaves.get(self._config.host):
            self._waiting.add(caller, reader, keys)
        return keys

    def fetch(self, caller: str, master: str, ids: Sequence[UUID]) -> list[DeliveredKey]:
        """Return keys that a master has got for this slave, each once; or raise Refused."""
        self._require_own(caller)
        self._host_of(master)
        return self._waiting.fetch(caller, master, ids)

    async def accept(self, manager: str, assignment: Assignment) -> None:
        """Take what another key manager assigns to applications here; or raise Refused."""
        host = next((name for name in self.stores if manager_name(name) == manager), None)
        if host is None or self._config.saes.get(assignment.master) != host:
            raise unauthorized()
        for slave in assignment.slaves:
            self._require_own(slave)
        for unwanted in assignment.void:
            self._stored.discard(host, unwanted)
        self._waiting.require_capacity(assignment.slaves, len(assignment.keys))
        key_ids = [each for key in assignment.keys for each in key.stored]
        stored = dict(zip(key_ids, await self._stored.taken_by_id(host, key_ids), strict=True))
        keys = [
            DeliveredKey(key.key_id, _opened(key, b"".join(stored[each] for each in key.stored)))
            for key in assignment.keys
        ]
        self._waiting.add(assignment.master, assignment.slaves, keys)

    async def accept_relay(self, manager: str, body: bytes) -> None:
        """Take keys that another key manager relays; or raise Refused or MalformedPacket."""
        await self._relaying.accept(manager, body)

    def _require_own(self, sae: str) -> None:
        if self._config.saes.get(sae) != self._config.host:
            raise unauthorized()

    def _host_of(self, sae: str) -> str:
        host = self._config.saes.get(sae)
        if host is None:
            raise bad_request(f"no KME here knows a SAE {sae!r}")
        return host

    def _grouped(self, slaves: Sequence[str]) -> dict[str, list[str]]:
        if len(set(slaves)) < len(slaves):
            raise bad_request("a slave SAE is named twice")
        hosts: dict[str, list[str]] = {}
        for slave in slaves:
            hosts.setdefault(self._host_of(slave), []).append(slave)
        return hosts

    def _size(self, request: KeyRequest) -> int:
        size = KEY_BITS if request.size is None else request.size
        if request.mandatory:
            raise bad_request(
                NOT_SUPPORTED, [{"extension_mandatory_unsupported": list(request.mandatory)}]
            )
        if size % 8:
            raise bad_request(NOT_MULTIPLE)
        if not MIN_BITS <= size <= MAX_BITS:
            raise bad_request(f"size shall be {MIN_BITS} to {MAX_BITS} bits")
        if request.number > MAX_IDS:
            raise bad_request(f"number shall be {MAX_IDS} at most")
        return size

    def _require_served(self, slaves: dict[str, list[str]]) -> None:
        for host in slaves:
            if not self._is_relayed(host):
                self._stored.require_given_out(host)

    def _require_stored(self, hosts: Sequence[str], count: int) -> None:
        for host in hosts:
            if self.stores[host].mine < count:
                raise unavailable(
                    f"{self.stores[host].mine} keys of {KEY_BITS} bits are left with "
                    f"{manager_name(host)}, {count} are wanted: ask again later"
                )

    def _is_relayed(self, host: str) -> bool:
        """Whether keys go to a host by others: no light is between, or somebody listens to it."""
        if self.router is None or host == self._config.host:
            return False
        return host in self.withheld or (host not in self._linked and not self.stores[host].mine)

    async def _available(self, caller: str, slave: str, host: str) -> int:
        if host == self._config.host:
            return CAPACITY
        if self.router is None or not self._is_relayed(host):
            return self.stores[host].mine
        try:
            route = await self.router.ask(host, stored_for(1, KEY_BITS), caller, slave)
        except Refused:
            return 0
        return route.stored - 1  # one more authenticates

    async def _route(self, caller: str, slave: str, host: str, number: int, size: int) -> KeyRoute:
        """Return by whom keys go to a host; of one that is withheld, why is why if nobody can."""
        assert self.router is not None  # or nothing is relayed
        try:
            return await self.router.ask(host, stored_for(number, size), caller, slave)
        except Refused:
            self._stored.require_given_out(host)
            raise

    def _register(self, host: str, caller: str, slave: str) -> None:
        """Let the controller know of an application, once."""
        if self.router is not None and (caller, slave) not in self._registered:
            task = asyncio.create_task(self.router.register(host, caller, slave))
            self._registered[caller, slave] = task

    async def _taken(self, host: str, count: int, each: int) -> list[list[StoredKey]]:
        taken = await self._stored.taken(host, count)
        return [taken[start : start + each] for start in range(0, count, each)]

    def _made(
        self, ids: Sequence[UUID], size: int, stored: Sequence[Sequence[StoredKey]] | None
    ) -> list[DeliveredKey]:
        """Return keys of a size in bytes: the beginning of stored ones, or drawn here."""
        if stored is None:
            return [DeliveredKey(key_id, os.urandom(size)) for key_id in ids]
        return [
            DeliveredKey(key_id, b"".join(key.key for key in each)[:size])
            for key_id, each in zip(ids, stored, strict=True)
        ]

    async def _assign(
        self, host: str, master: str, slaves: list[str], keys: list[AssignedKey]
    ) -> None:
        """Tell a slave's manager; what it does not take is void, and it hears so next time."""
        void = self._stored.void(host)
        try:
            await self._tell(host, Assignment(master, tuple(slaves), tuple(keys), void))
        except Refused:
            self._stored.lose(host, [*void, *(each for key in keys for each in key.stored)])
            raise


def _assigned(key: DeliveredKey, stored: Sequence[StoredKey], *, masked: bool) -> AssignedKey:
    pad = b"".join(each.key for each in stored)
    ids = tuple(each.key_id for each in stored)
    return AssignedKey(key.key_id, 8 * len(key.key), ids, _xor(key.key, pad) if masked else b"")


def _opened(key: AssignedKey, stored: bytes) -> bytes:
    """Return the key that is delivered; raise Refused if too little is stored for it."""
    if len(stored) * 8 < key.size:
        raise bad_request(f"{len(stored) * 8} stored bits make no key of {key.size}")
    return _xor(key.masked, stored) if key.masked else stored[: key.size // 8]


def _xor(data: bytes, pad: bytes) -> bytes:
    return bytes(a ^ b for a, b in zip(data, pad[: len(data)], strict=True))
