"""Secrets that a host shares with each other host: random bytes that both were given before."""

import os
import secrets
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

SECRET_BYTES = 32


class PairSecrets(Mapping[str, str]):
    """The secrets of one host by other host, in hex.

    They are files in a private folder, one for two hosts. Which of the two first needs it draws
    it: so what there is grows with the pairs that use it, and not with all that could.
    """

    def __init__(self, host: str, folder: str, hosts: Callable[[], Collection[str]]) -> None:
        """Share with these hosts, in a folder of all secrets; "": with nobody."""
        self._host, self._folder, self._hosts = host, folder, hosts

    def __getitem__(self, other: str) -> str:
        if other not in self._others():
            raise KeyError(other)
        file = Path(self._folder, ":".join(sorted((self._host, other))))
        if not file.exists():
            drawn = file.with_name(f".{file.name}-{os.getpid()}")
            drawn.touch(mode=0o600)
            drawn.write_text(secrets.token_hex(SECRET_BYTES))
            with suppress(FileExistsError):  # the other has drawn it meanwhile
                os.link(drawn, file)
            drawn.unlink()
        return file.read_text()

    def __contains__(self, other: object) -> bool:
        return other in self._others()

    def __iter__(self) -> Iterator[str]:
        return iter(self._others())

    def __len__(self) -> int:
        return len(self._others())

    def _others(self) -> set[str]:
        return set(self._hosts()) - {self._host} if self._folder else set()
