"""Reasons for which the filling of key stores ends: a stack that is gone, or a fault."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from applications.keys import filling
from applications.keys.sessions import StackGone

GONE, FAULT = StackGone("the stack of alice is gone"), ValueError("a fault")


@pytest.mark.parametrize("faults", [[GONE], [GONE, FAULT], [FAULT]])
def test_a_stack_that_is_gone_is_named_and_a_fault_is_not_hidden_by_it(
    faults: list[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = asyncio.Event()

    async def keep(_config: Any, _delivery: Any, _states: Any, link: Any) -> None:
        if link.fault is faults[-1]:
            begun.set()
        await begun.wait()
        raise link.fault

    monkeypatch.setattr(filling, "_keep", keep)
    links = [SimpleNamespace(opens=True, fault=fault) for fault in faults]
    config: Any = SimpleNamespace(links=links)
    with pytest.raises((StackGone, ExceptionGroup)) as caught:
        asyncio.run(filling.fill(config, Any, Any))  # type: ignore[arg-type]
    if FAULT in faults:
        assert isinstance(caught.value, ExceptionGroup)
        assert FAULT in caught.value.exceptions
    else:
        assert str(caught.value) == "the stack of alice is gone"
