"""Deliveries of a key manager, and to whom: ETSI GS QKD 014 without the HTTP.

    SAE a -- enc_keys --> KME of a -- assignment --> KME of b
          <-- id, key ---                              |
          --- id, by whatever way a and b have --> SAE b -- dec_keys --> the same key

Keys that this end hands out first become the master's; the slave's manager removes the same ones
before the master gets any. A slave of a third host gets the key masked with keys shared with that
host. Applications of one manager get keys that it draws: between them is no light.
"""

import asyncio
import os
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from uuid import UUID, uuid4

from hosts.key_delivery.allowance import Allowance
from hosts.key_delivery.refusals import (
    NOT_MULTIPLE,
    NOT_SUPPORTED,
    Refused,
    bad_request,
    unauthorized,
    unavailable,
)
from hosts.key_delivery.waiting import WaitingKeys
from hosts.middleware.qkd.key_store import KEY_BITS, KeyStore, MissingKey, StoredKey
from hosts.middleware.qkd.keyring import CAPACITY, store_in
from hosts.network_loop import now_s
from wire.key_assignment import MAX_BITS, AssignedKey, Assignment
from wire.key_delivery import MAX_IDS, MAX_NAMES, DeliveredKey, KeyRequest, Status
from wire.key_manager import KeyManagerConfig, manager_name

MIN_BITS = 8
BURST = MAX_IDS * MAX_BITS // KEY_BITS  # the largest request
STORING_S = 2.0  # of the network: one end stores the keys of a session before the other
LOOK_S = 0.05
MOST_VOID = 4096  # ids that another manager has not been told to throw away

Tell = Callable[[str, Assignment], Awaitable[None]]  # a host's key manager; raises Refused


class KeyDelivery:
    """The keys of one host's applications."""

    def __init__(self, config: KeyManagerConfig, tell: Tell) -> None:
        """Open the stores; KeyStoreError if one cannot be."""
        self._config, self._tell = config, tell
        others = [host for host in config.hosts if host != config.host]
        self.stores: dict[str, KeyStore] = {
            host: store_in(Path(config.keys), host) for host in others
        }
        self._waiting = WaitingKeys(now_s)
        self._allowance = Allowance(config.keys_per_s, BURST, now_s)
        self._void: dict[str, list[UUID]] = {host: [] for host in others}
        self.withholds = config.withhold  # whether too many errors close the way to a host
        self.withheld: dict[str, str] = {}  # hosts that no key goes out for: why

    def status(self, caller: str, slave: str) -> Status:
        """Say what is there for a master and a slave; raise Refused for who is none."""
        self._require_own(caller)
        target = self._host_of(slave)
        local = target == self._config.host
        return Status(
            source_KME_ID=manager_name(self._config.host),
            target_KME_ID=manager_name(target),
            master_SAE_ID=caller,
            slave_SAE_ID=slave,
            key_size=KEY_BITS,
            stored_key_count=CAPACITY if local else self.stores[target].mine,
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
        for host in remote:
            if self.stores[host].mine < count:
                raise unavailable(
                    f"{self.stores[host].mine} keys of {KEY_BITS} bits are left with "
                    f"{manager_name(host)}, {count} are wanted: ask again later"
                )
        self._allowance.take(caller, count * max(1, len(remote)))
        ids = [uuid4() for _ in range(request.number)]
        stored = {host: await self._taken(host, count, stored_each) for host in remote}
        keys = self._made(ids, size // 8, stored.get(remote[0]) if remote else None)
        for number, host in enumerate(remote):
            assigned = [
                _assigned(key, each, masked=number > 0)
                for key, each in zip(keys, stored[host], strict=True)
            ]
            await self._assign(host, caller, slaves[host], assigned)
        if own := slaves.get(self._config.host):
            self._waiting.add(caller, own, keys)
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
            self.stores[host].discard(unwanted)
        self._waiting.require_capacity(assignment.slaves, len(assignment.keys))
        wanted = [each for key in assignment.keys for each in key.stored]
        found = dict(zip(wanted, await self._stored(host, wanted), strict=True))
        keys = [
            DeliveredKey(key.key_id, _opened(key, b"".join(found[each] for each in key.stored)))
            for key in assignment.keys
        ]
        self._waiting.add(assignment.master, assignment.slaves, keys)

    def _require_own(self, sae: str) -> None:
        if self._config.saes.get(sae) != self._config.host:
            raise unauthorized()

    def _host_of(self, sae: str) -> str:
        host = self._config.saes.get(sae)
        if host is None:
            raise bad_request(f"no KME here knows a SAE {sae!r}")
        return host

    def _grouped(self, slaves: Sequence[str]) -> dict[str, list[str]]:
        """Return slaves by host, in their order."""
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
            if host in self.withheld:
                raise unavailable(
                    f"no key is given with {manager_name(host)}: {self.withheld[host]}"
                )

    async def _taken(self, host: str, count: int, each: int) -> list[list[StoredKey]]:
        """Return stored keys, so many for each key that is delivered."""
        try:
            taken = await asyncio.to_thread(self.stores[host].take_oldest, count)
        except MissingKey as error:
            raise unavailable(str(error)) from error
        return [taken[start : start + each] for start in range(0, count, each)]

    def _made(
        self, ids: Sequence[UUID], size: int, stored: Sequence[Sequence[StoredKey]] | None
    ) -> list[DeliveredKey]:
        """Return keys of so many bytes: the beginning of stored ones, or drawn here."""
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
        void = tuple(self._void[host])
        self._void[host].clear()
        try:
            await self._tell(host, Assignment(master, tuple(slaves), tuple(keys), void))
        except Refused:
            lost = [*void, *(each for key in keys for each in key.stored)]
            self._void[host] = [*self._void[host], *lost][-MOST_VOID:]
            raise

    async def _stored(self, host: str, wanted: Sequence[UUID]) -> list[bytes]:
        """Return stored keys; of the newest session they may come a moment later."""
        deadline = now_s() + STORING_S
        while True:
            try:
                return await asyncio.to_thread(self.stores[host].take_all, wanted)
            except MissingKey as error:
                if now_s() > deadline:
                    raise unavailable(str(error)) from error
            await asyncio.sleep(LOOK_S)


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
