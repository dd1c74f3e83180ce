"""What a host shares with each other host: random bytes that both were given before."""

from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path

from wire.pair_secrets import secret_file


class PairSecrets(Mapping[str, str]):
    """The secrets of one host by other host, in hex.

    They are files in a private folder (wire/pair_secrets.py).
    """

    def __init__(self, host: str, folder: str, hosts: Callable[[], Collection[str]]) -> None:
        """Share with these hosts, in a folder of all secrets; "": with nobody."""
        self._host, self._folder, self._hosts = host, folder, hosts

    def __getitem__(self, other: str) -> str:
        if other not in self._others():
            raise KeyError(other)
        return secret_file(Path(self._folder), self._host, other).read_text()

    def __contains__(self, other: object) -> bool:
        return other in self._others()

    def __iter__(self) -> Iterator[str]:
        return iter(self._others())

    def __len__(self) -> int:
        return len(self._others())

    def _others(self) -> set[str]:
        return set(self._hosts()) - {self._host} if self._folder else set()
