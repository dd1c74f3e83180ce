"""HTTP requests that no program of ours would make."""

import json
from collections.abc import Iterable
from typing import Any
from wsgiref.util import setup_testing_defaults
from wsgiref.validate import validator

import pytest

from controller_apps.console.guard import Guard

ADDRESS, TOKEN = "127.0.0.1:8080", "0123456789abcdef"
GOOD = {
    "HTTP_HOST": ADDRESS,
    "HTTP_AUTHORIZATION": f"Bearer {TOKEN}",
    "CONTENT_TYPE": "application/json; charset=utf-8",
    "REQUEST_METHOD": "POST",
    "PATH_INFO": "/qmn/devices/alice",
    "QUERY_STRING": "",
}


def served(_environment: dict[str, Any], start_response: Any) -> Iterable[bytes]:
    start_response("200 OK", [("Content-Type", "text/plain")])
    return [b"served"]


def ask(changes: dict[str, str | None], token: str = TOKEN) -> tuple[str, bytes]:
    """Return status and body; a header that is None is not sent."""
    environment: dict[str, Any] = {}
    setup_testing_defaults(environment)
    environment |= GOOD | changes
    environment = {name: value for name, value in environment.items() if value is not None}
    reports: list[str] = []

    def start_response(status: str, _headers: Any, _error: Any = None) -> Any:
        reports.append(status)

    answer = validator(Guard(served, ADDRESS, token))(environment, start_response)  # of PEP 3333
    body = b"".join(answer)
    answer.close()  # type: ignore[attr-defined]
    return reports[0], body


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"HTTP_HOST": "localhost:8080"},
        {"HTTP_ORIGIN": f"http://{ADDRESS}"},
        {"REQUEST_METHOD": "GET", "CONTENT_TYPE": None},
        {"PATH_INFO": "/stats/switches", "HTTP_AUTHORIZATION": None, "CONTENT_TYPE": None},
    ],
)
def test_what_programs_of_this_machine_ask_is_served(changes: dict[str, str | None]) -> None:
    assert ask(changes) == ("200 OK", b"served")


@pytest.mark.parametrize(
    ("changes", "status", "words"),
    [
        ({"HTTP_HOST": "evil.example:8080"}, "421", "ask for 127.0.0.1:8080 or localhost:8080"),
        ({"HTTP_HOST": None}, "421", "Host is ''"),
        ({"HTTP_ORIGIN": "http://evil.example"}, "403", "pages of others"),
        ({"HTTP_ORIGIN": "null"}, "403", "Origin is 'null'"),
        ({"PATH_INFO": "/stats/x", "HTTP_ORIGIN": "https://a.example"}, "403", "pages of others"),
        ({"CONTENT_TYPE": "text/plain"}, "415", "Content-Type is 'text/plain': send application/j"),
        ({"CONTENT_TYPE": None}, "415", "Content-Type is ''"),
        ({"HTTP_AUTHORIZATION": None}, "401", "Authorization: Bearer"),
        ({"PATH_INFO": "/restconf/data/x", "HTTP_AUTHORIZATION": None}, "401", "Bearer"),
        ({"HTTP_AUTHORIZATION": "Bearer wrong"}, "401", "rest-token"),
        ({"HTTP_AUTHORIZATION": "Bearer \xff"}, "401", "rest-token"),
    ],
)
def test_what_a_page_of_another_makes_a_browser_ask_is_refused(
    changes: dict[str, str | None], status: str, words: str
) -> None:
    report, body = ask(changes)
    assert report.startswith(status)
    assert words in json.loads(body)["error"]


def test_without_a_token_nobody_is_let_in() -> None:
    assert ask({"HTTP_AUTHORIZATION": "Bearer "}, "")[0] == "401 Unauthorized"
