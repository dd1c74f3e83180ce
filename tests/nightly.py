"""Leaves most cases of a test to the night: a plug-in of pytest.

@pytest.mark.by_day(every=3)  # of a test with parameters

is each third case, by the sum of the positions of its parameters: of several parametrisations every
value is tried by day. The others are `nightly`.
"""

import pytest


@pytest.hookimpl(tryfirst=True)  # before -m looks at markers
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the cases of the night."""
    for item in items:
        marker = item.get_closest_marker("by_day")
        if marker is not None and sum(positions(item)) % marker.kwargs["every"]:
            item.add_marker(pytest.mark.nightly)


def positions(item: pytest.Item) -> list[int]:
    """Return which of its values each parametrisation of a case has, counted from 0.

    pytest numbers the cases of a test; the values of the last parametrisation change first.
    """
    markers = [*item.iter_markers("parametrize")]
    first = markers[0].args[0]
    name = first.split(",")[0].strip() if isinstance(first, str) else first[0]
    number: int = item.callspec.indices[name]  # type: ignore[attr-defined]
    found = []
    for marker in reversed(markers):
        number, position = divmod(number, len(marker.args[1]))
        found.append(position)
    return found
