"""The guard of HTTP: it serves programs of this machine that have the token.

A web page that a person has open here can make the browser ask, too: by its own name for our
address (Host), from its own pages (Origin), with a body that needs no leave (Content-Type). Stock
apps' own resources know no token; the rest holds for them as well.
"""

import hmac
import json
from collections.abc import Callable, Iterable
from typing import Any

Environment = dict[str, Any]  # of a request: PEP 3333
StartResponse = Callable[[str, list[tuple[str, str]]], object]
Application = Callable[[Environment, StartResponse], Iterable[bytes]]
OURS = "/qmn/", "/restconf/"
JSON = "application/json"


class Guard:
    """A WSGI application before another, which answers what that one must not see."""

    def __init__(self, application: Application, address: str, token: str) -> None:
        """Guard an application that is served at an address, such as 127.0.0.1:8080."""
        self._application = application
        host, _, port = address.rpartition(":")
        self._hosts = {address, f"localhost:{port}"} | (
            {host, "localhost"} if port == "80" else set()
        )
        self._token = token

    def __call__(self, environment: Environment, start_response: StartResponse) -> Iterable[bytes]:
        refusal = self.refusal(environment)
        if refusal is None:
            return self._application(environment, start_response)
        status, text = refusal
        body = json.dumps({"error": text}).encode()
        headers = [("Content-Type", JSON), ("Content-Length", str(len(body)))]
        if status.startswith("401"):
            headers.append(("WWW-Authenticate", "Bearer"))
        start_response(status, headers)
        return [body]

    def refusal(self, environment: Environment) -> tuple[str, str] | None:
        """Return status and reason if a request is refused, None if it is not."""
        host, origin = environment.get("HTTP_HOST", ""), environment.get("HTTP_ORIGIN")
        if host not in self._hosts:
            names = " or ".join(sorted(self._hosts))
            return "421 Misdirected Request", f"Host is {host!r}: ask for {names}"
        if origin is not None and origin.removeprefix("http://") not in self._hosts:
            return "403 Forbidden", f"Origin is {origin!r}: pages of others may not ask"
        if not environment.get("PATH_INFO", "").startswith(OURS):
            return None
        kind = environment.get("CONTENT_TYPE", "").partition(";")[0].strip().lower()
        if environment.get("REQUEST_METHOD") == "POST" and kind != JSON:
            return "415 Unsupported Media Type", f"Content-Type is {kind!r}: send {JSON}"
        header = environment.get("HTTP_AUTHORIZATION", "").encode("latin-1", "replace")
        if not self._token or not hmac.compare_digest(header, f"Bearer {self._token}".encode()):
            text = "send the header Authorization: Bearer and the token of this network, which is "
            return "401 Unauthorized", f"{text}in rest-token in its private folder"
        return None
