"""The stored keys of a host: what is taken of them, withheld, and lost on the way."""

import asyncio
from collections.abc import Iterable, Sequence
from pathlib import Path
from uuid import UUID

from applications.keys.config import KeyManagerConfig, manager_name
from applications.keys.refusals import unavailable
from applications.qkd.key_files import MissingKey
from applications.qkd.key_store import KeyStore, StoredKey
from applications.qkd.keyring import store_in
from applications.timeouts import STORING_LOOK_S, STORING_TIMEOUT_S
from hosts.network_loop import now_s

MOST_VOID = 4096  # ids that another manager has yet to throw away


class StoredKeys:
    def __init__(self, config: KeyManagerConfig) -> None:
        """Open the stores; KeyStoreError if one cannot be."""
        others = [host for host in config.hosts if host != config.host]
        self.stores: dict[str, KeyStore] = {
            host: store_in(Path(config.keys), host) for host in others
        }
        self._void: dict[str, list[UUID]] = {host: [] for host in others}
        self.withheld: dict[str, str] = {}  # hosts that no key goes out for: why

    def require_given_out(self, host: str) -> None:
        """Raise Refused if no key goes out for a host."""
        if host in self.withheld:
            raise unavailable(f"no key is given with {manager_name(host)}: {self.withheld[host]}")

    async def taken(self, host: str, count: int) -> list[StoredKey]:
        """Return stored keys that this end hands out first; or raise Refused."""
        try:
            return await asyncio.to_thread(self.stores[host].take_oldest, count)
        except MissingKey as error:
            raise unavailable(str(error)) from error

    async def taken_by_id(self, host: str, key_ids: Sequence[UUID]) -> list[bytes]:
        """Return stored keys that the other end has taken; of the newest session they may be late.

        Raise Refused if they do not come.
        """
        deadline = now_s() + STORING_TIMEOUT_S
        while True:
            try:
                return await asyncio.to_thread(self.stores[host].take_all, key_ids)
            except MissingKey as error:
                if now_s() > deadline:
                    raise unavailable(str(error)) from error
            await asyncio.sleep(STORING_LOOK_S)

    def discard(self, host: str, unwanted: UUID) -> None:
        self.stores[host].discard(unwanted)

    def void(self, host: str) -> tuple[UUID, ...]:
        """Return the ids of keys that the other end does not know are lost; they go with this."""
        void = tuple(self._void[host])
        self._void[host].clear()
        return void

    def lose(self, host: str, lost: Iterable[UUID]) -> None:
        """Note keys that the other end has not taken: it hears so next time."""
        self._void[host] = [*self._void[host], *lost][-MOST_VOID:]
