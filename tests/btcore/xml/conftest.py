"""Fixtures of the tests of XML: leaves for trees with errors."""

from typing import Protocol

import pytest

from btcore import In, Registry, SyncAction, action


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
    for id, thing in {"Drive": drive, "Say": hello}.items():
        made.add(thing, ID=id)
    return made
