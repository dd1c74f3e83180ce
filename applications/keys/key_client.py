"""A program's way to its host's key manager: ETSI GS QKD 014 over mutual TLS."""

import http.client
import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import quote
from uuid import UUID

from applications.keys.key_delivery import (
    MAX_ANSWER,
    DeliveredKey,
    KeyRequest,
    decode_keys,
    decode_refusal,
    encode_key_ids,
    encode_request,
)
from applications.timeouts import KEY_MANAGER_TIMEOUT_S
from wire.malformed import MalformedPacket

OK = 200


class NoKey(Exception):
    """The key manager gives none; the text says why."""


@dataclass(frozen=True)
class KeyClient:
    """An application's view of its key manager; certificates are paths of PEM files."""

    address: str
    port: int
    certificate: str
    private_key: str
    authority: str

    def get(self, slave: str, request: KeyRequest) -> list[DeliveredKey]:
        """Return new keys shared with a slave SAE; NoKey if there are none now."""
        return self._ask(slave, "enc_keys", encode_request(request))

    def fetch(self, master: str, ids: Sequence[UUID]) -> list[DeliveredKey]:
        """Return the keys of these ids that a master SAE has got; NoKey if they are not here."""
        return self._ask(master, "dec_keys", encode_key_ids(ids))

    def _ask(self, sae: str, call: str, body: bytes) -> list[DeliveredKey]:
        path = f"/api/v1/keys/{quote(sae, safe='')}/{call}"
        connection = http.client.HTTPSConnection(
            self.address, self.port, timeout=KEY_MANAGER_TIMEOUT_S, context=self._context()
        )
        try:
            connection.request("POST", path, body, {"Content-Type": "application/json"})
            response = connection.getresponse()
            answer = response.read(MAX_ANSWER + 1)
            if response.status != OK:
                raise NoKey(f"{response.status} {_message(answer)}")
            return decode_keys(answer)
        except (OSError, http.client.HTTPException, MalformedPacket) as error:
            raise NoKey(f"the key manager at {self.address} does not answer: {error}") from error
        finally:
            connection.close()

    def _context(self) -> ssl.SSLContext:
        context = ssl.create_default_context(cafile=self.authority)
        context.load_cert_chain(self.certificate, self.private_key)
        return context


def _message(answer: bytes) -> str:
    return decode_refusal(answer) if answer else "not allowed"
