"""What the tests of static checks share: a palette of leaves, and a way to ask what is said of a document."""

from collections.abc import Collection
from textwrap import dedent

import pytest

from btcore import Blackboard, In, Put, Registry, StatefulAction, Status, action, condition
from btcore.errors import Diagnostic
from btcore.xml.source import read_text
from btcore.xml.validate import validate_document


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


class Drive(StatefulAction):
    goal: In[str] = "home"

    def on_start(self) -> Status:
        return Status.RUNNING


class Grasp(StatefulAction):
    def on_start(self) -> Status:
        return Status.RUNNING


@pytest.fixture
def palette() -> Registry:
    made = Registry.standard()
    made.add(battery_ok, say, count, look, tidy, Drive, Grasp)
    return made


class Checker:
    """Asks the validator about a main tree with *body*, and *more* trees beside it."""

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
        return validate_document(read_text(text, "t.xml"), nodes=self.palette, given=given)

    def __call__(self, body: str, more: str = "", format: int = 4, given: Collection[str] = ()) -> str:
        """All that is said, as a user reads it."""
        return "".join(f"{one}\n" for one in self.found(body, more, format, given))


@pytest.fixture
def check(palette: Registry) -> Checker:
    return Checker(palette)


def tree(ID: str, body: str = "<AlwaysSuccess/>") -> str:
    return f'  <BehaviorTree ID="{ID}">\n    {body}\n  </BehaviorTree>\n'


def said(text: str) -> str:
    """*text* without the indentation of the test that it stands in."""
    return dedent(text).lstrip("\n")
