"""Fixtures of the tests of checks: a registry of leaves, and a function that checks documents."""

from collections.abc import Collection

import pytest

from btcore import Blackboard, In, Put, Registry, StatefulAction, Status, action, condition
from btcore.diagnostics import Diagnostic
from btcore.lint.validate import validate_document
from btcore.xml.read.read import parse_text


@condition
def battery_ok(minimum: In[float] = 0.2) -> bool:
    return minimum > 0


@action
def say(text: In[str]) -> bool:
    return bool(text)


@action
def count(start: In[int], result: Put[int]) -> bool:
    result(start + 1)
    return True


@action
def look(found: Put[str]) -> bool:
    found("a door")
    return True


@action
def tidy(board: Blackboard) -> bool:
    return "x" in board


class Lasting(StatefulAction):
    def on_start(self) -> Status:
        return Status.RUNNING

    def on_running(self) -> Status:
        return Status.RUNNING


class Drive(Lasting):
    goal: In[str] = "home"


class Grasp(Lasting):
    pass


@pytest.fixture
def palette() -> Registry:
    made = Registry.standard()
    made.add(battery_ok, say, count, look, tidy, Drive, Grasp)
    return made


class Checker:
    """Validates a document with *body* in its main tree and *more* as further trees."""

    def __init__(self, palette: Registry) -> None:
        self.palette = palette

    def found(
        self, body: str, more: str = "", format: int = 4, given: Collection[str] = (), **root: str
    ) -> list[Diagnostic]:
        attributes = "".join(f' {key}="{value}"' for key, value in root.items())
        text = (
            f'<root BTCPP_format="{format}" main_tree_to_execute="Main"{attributes}>\n'
            f'  <BehaviorTree ID="Main">\n    {body}\n  </BehaviorTree>\n{more}</root>\n'
        )
        return self.found_in(text, given)

    def found_in(self, text: str, given: Collection[str] = ()) -> list[Diagnostic]:
        return validate_document(parse_text(text, "t.xml"), nodes=self.palette, given=given)

    def __call__(self, body: str, more: str = "", format: int = 4, given: Collection[str] = ()) -> str:
        """Return all diagnostics as a user reads them."""
        return "".join(f"{one}\n" for one in self.found(body, more, format, given))


@pytest.fixture
def check(palette: Registry) -> Checker:
    return Checker(palette)
