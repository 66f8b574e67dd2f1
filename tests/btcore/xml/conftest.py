"""Fixtures of the tests of XML: leaves for trees with errors, and functions for such trees."""

from collections.abc import Callable
from typing import Protocol

import pytest

from btcore import In, Registry, SyncAction, action
from btcore.errors import TreeError
from btcore.loading.instantiate import instantiate
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.document import parse_text


class Robot:
    pass


class Arm(Protocol):
    def lift(self) -> None: ...


@action
def drive(speed: In[float], robot: Robot) -> bool:
    return speed > 0


@action
def hello(text: In[str] = "hi") -> bool:
    return bool(text)


@action
def turn(angle: float) -> bool:
    return angle > 0


@action
def lift(arm: Arm) -> bool:
    arm.lift()
    return True


class Broken(SyncAction):
    def __init__(self) -> None:
        raise ValueError("no camera")


@pytest.fixture
def nodes() -> Registry:
    """Return a registry of leaves for trees with errors."""
    made = Registry.standard()
    made.add(turn, lift, Broken)
    for ID, thing in {"Drive": drive, "Say": hello}.items():
        made.add(thing, ID=ID)
    return made


@pytest.fixture
def tree_error(
    nodes: Registry, document: Callable[..., str]
) -> Callable[[str | tuple[object, ...]], TreeError]:
    """Return a function that returns a document's error; it takes a text or arguments of *document*."""

    def make(source: str | tuple[object, ...]) -> TreeError:
        text = source if isinstance(source, str) else document(*source)
        with pytest.raises(TreeError) as caught:
            instantiate(plan_document(parse_text(text, "t.xml"), nodes), resources=[nodes])
        return caught.value

    return make
