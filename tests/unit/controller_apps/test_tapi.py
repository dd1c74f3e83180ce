"""Light paths in the terms of ONF's Transport API, by the names of its YANG modules."""

import json
from typing import Any
from uuid import UUID

import pytest
from metadata_scene import BOB, FRAMED, Q1, S1, arbiter, frame

from controller_apps.console import tapi
from controller_apps.console.views import fibers_view, paths_view, sessions_view

SERVICES = "tapi-common:context/tapi-connectivity:connectivity-context/connectivity-service"


@pytest.fixture
def tree() -> Any:
    state = arbiter()
    state.segment_arrived(S1, 1, frame(FRAMED.encode(), destination=BOB), 10.0)
    views = paths_view(state.sessions, state.network), fibers_view(state.network)
    return tapi.context(*views, sessions_view(state.sessions, state.network, 10.0))


def test_each_light_path_is_a_connectivity_service_between_fibres(tree: Any) -> None:
    (services,) = tapi.resource(tree, SERVICES).values()
    assert len(services) == 3
    context = tree["tapi-common:context"]
    points = {each["uuid"]: each["name"][0]["value"] for each in context["service-interface-point"]}
    ends = [
        tuple(points[end["service-interface-point"]["service-interface-point-uuid"]] for end in two)
        for two in (service["end-point"] for service in services)
    ]
    assert ends == [("charlie-q0", "alice-q0"), ("alice-q0", "bob-q1"), ("charlie-q1", "bob-q0")]
    for service in services:
        assert service["layer-protocol-name"] == "PHOTONIC_MEDIA"
        # No switch has answered yet: TAPI 2.1.3, lifecycle-state and operational-state.
        assert (service["lifecycle-state"], service["operational-state"]) == ("PLANNED", "DISABLED")
        assert UUID(service["uuid"])
    json.dumps(tree)


def test_a_service_is_found_by_its_uuid_and_names_its_connection(tree: Any) -> None:
    first = tapi.resource(tree, SERVICES)["tapi-connectivity:connectivity-service"][0]
    one = tapi.resource(tree, f"{SERVICES}={first['uuid']}")
    assert one == {"tapi-connectivity:connectivity-service": [first]}
    (connection,) = first["connection"]
    place = f"{SERVICES.rpartition('/')[0]}/connection={connection['connection-uuid']}"
    ((found,),) = tapi.resource(tree, place).values()
    assert found["name"] == [{"value-name": "ROUTE", "value": f"{Q1:016x}:4-1"}]


def test_a_path_may_leave_out_modules_and_the_whole_is_there(tree: Any) -> None:
    assert tapi.resource(tree, "tapi-common:context") == tree
    assert tapi.resource(tree, "context/connectivity-context/connectivity-service") is not None


@pytest.mark.parametrize(
    "path",
    [
        "",
        "nothing",
        f"{SERVICES}=0",
        "tapi-common:context=1",
        f"{SERVICES}/uuid",
        "a=b=c",
        "=",
        "//",
    ],
)
def test_what_is_not_there_is_not_found(tree: Any, path: str) -> None:
    assert tapi.resource(tree, path) is None
    (error,) = tapi.not_found(path)["ietf-restconf:errors"]["error"]
    assert error["error-tag"] == "invalid-value"
