"""Fixtures of the XML tests: registries of leaves, and functions that check documents."""

from collections.abc import Callable, Collection, Mapping
from typing import Protocol

import pytest

from btcore import Blackboard, In, Put, Registry, StatefulAction, Status, SyncAction, action, condition
from btcore.errors import Diagnostic, TreeError
from btcore.loading.instantiate import instantiate
from btcore.xml.lint.validate import validate_document
from btcore.xml.plan.plan import define_and_plan
from btcore.xml.read.read import parse_text, read


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


# --- trees with errors


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
def document() -> Callable[..., str]:
    """Return a function that writes a document; *root* holds the attributes of its root element."""

    def write(
        body: str,
        others: Mapping[str, str] | str = "",
        root: str = 'BTCPP_format="4" main_tree_to_execute="Main"',
    ) -> str:
        if not isinstance(others, str):
            lines = [f'  <BehaviorTree ID="{ID}">{inside}</BehaviorTree>\n' for ID, inside in others.items()]
            others = "".join(lines)
        return f'<root {root}>\n  <BehaviorTree ID="Main">\n    {body}\n  </BehaviorTree>\n{others}</root>\n'

    return write


@pytest.fixture
def tree_error(
    nodes: Registry, document: Callable[..., str]
) -> Callable[[str | tuple[object, ...]], TreeError]:
    """Return a function that returns a document's error; it takes a text or arguments of *document*."""

    def make(source: str | tuple[object, ...]) -> TreeError:
        text = source if isinstance(source, str) else document(*source)
        with pytest.raises(TreeError) as caught:
            instantiate(define_and_plan(read(parse_text(text, "t.xml")), nodes), resources=[nodes])
        return caught.value

    return make
