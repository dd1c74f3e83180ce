"""The console's facts over HTTP, by Ryu's own WSGI server; os-ken has none.

GET  /qmn/devices    GET  /qmn/paths    GET  /qmn/sessions    GET  /qmn/keys
GET  /restconf/data/tapi-common:context (controller_apps.console.tapi)
POST /qmn/devices/alice    {"rate_hz": 1000000, "fec": "golay"}
"""

import json
from collections.abc import Callable
from typing import Any, TypeVar

from controller_apps.console import tapi
from controller_apps.console.facts import PACKAGE_APPS, Facts, check_settings_request
from controller_apps.console.questions import Refused
from controller_apps.openflow.framework import App, app_manager, wsgi
from wire.controller_lines import MAX_REQUEST

YANG_DATA = "application/yang-data+json"  # RFC 8040, 11.3.2
Handler = TypeVar("Handler", bound=Callable[..., Any])
route: Callable[..., Callable[[Handler], Handler]] = wsgi().route


class Rest(App):
    """Puts the resources into the WSGI application that stock apps share."""

    _CONTEXTS = {"wsgi": wsgi().WSGIApplication}  # noqa: RUF012 (the framework's name and type)

    def __init__(self, **contexts: Any) -> None:
        super().__init__(**contexts)
        contexts["wsgi"].register(Resources)


class Resources(wsgi().ControllerBase):  # type: ignore[misc]
    """One object a request, made by the framework."""

    @route("devices", "/qmn/devices", methods=["GET"])
    def devices(self, request: Any, **_: Any) -> Any:
        return answer(lambda facts: facts.devices())

    @route("paths", "/qmn/paths", methods=["GET"])
    def paths(self, request: Any, **_: Any) -> Any:
        return answer(lambda facts: facts.paths())

    @route("sessions", "/qmn/sessions", methods=["GET"])
    def sessions(self, request: Any, **_: Any) -> Any:
        return answer(lambda facts: facts.sessions())

    @route("tapi", "/restconf/data/{path:.*}", methods=["GET"])
    def tapi(self, request: Any, path: str, **_: Any) -> Any:
        try:
            resource = tapi.resource(known_facts().tapi(), path)
        except Refused as refused:
            return response(503, {"error": str(refused)})
        if resource is None:
            return response(404, tapi.not_found(path), YANG_DATA)
        return response(200, resource, YANG_DATA)

    @route("keys", "/qmn/keys", methods=["GET"])
    def keys(self, request: Any, **_: Any) -> Any:
        """Return key links and applications, in the words of ETSI GS QKD 015."""
        return answer(lambda facts: facts.of_package("keys"))

    @route("set", "/qmn/devices/{name}", methods=["POST"])
    def set(self, request: Any, name: str, **_: Any) -> Any:
        if request.content_length is None or request.content_length > MAX_REQUEST:
            return response(413, {"error": f"give a body of at most {MAX_REQUEST} bytes"})
        try:
            settings = check_settings_request(json.loads(request.body))
        except (ValueError, RecursionError) as error:
            return response(400, {"error": f"the body is not JSON: {error}"})
        except Refused as refused:
            return response(400, {"error": str(refused)})
        return answer(lambda facts: facts.set(name, settings))


def answer(call: Callable[[Facts], Any]) -> Any:
    """Return the facts, or 400 with the reason why not."""
    try:
        return response(200, call(known_facts()))
    except Refused as refused:
        return response(400, {"error": str(refused)})


def known_facts() -> Facts:
    app = app_manager.lookup_service_brick
    packages = {each.name: app(each.attr) for each in PACKAGE_APPS}
    return Facts(app("QuantumMetadata"), app("DeviceMonitor"), packages)


def response(status: int, content: Any, kind: str = "application/json") -> Any:
    body = json.dumps(content).encode()
    return wsgi().Response(status=status, content_type=kind, body=body)
