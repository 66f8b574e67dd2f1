"""Nodes with code of users: what the search cannot repeat makes the answers unknown, with a reason."""

import random
from collections.abc import Callable
from inspect import get_annotations
from itertools import count
from random import choice
from types import ModuleType
from typing import Any

import pytest

import btcore
from btcore import NodeSpec, Status
from btcore.clock import NS_PER_S, Clock
from btcore.status import FAILURE, SUCCESS
from btcore_proof.prover import PROVED, REFUTED, UNKNOWN_ANSWER, Answer
from tests.tools.btcore_proof.trees import ConditionLeaf, InstantLeaf, answers_of, prover_of

LOG: list[int] = []
MISSING = object()
GENERATOR = random.Random(1)
QUESTION = "never Right is SUCCESS"


class Ready(ConditionLeaf):
    pass


class Left(InstantLeaf):
    pass


class Right(InstantLeaf):
    pass


class Sense(InstantLeaf):
    value: btcore.Out[int]


@pytest.fixture
def decorator(
    request: pytest.FixtureRequest, acceptance_script: Callable[[str], ModuleType]
) -> type[btcore.TreeNode]:
    """A class of this file, or by its name a class of `proof_plugins.py`, which random trees use, too."""
    cls: type[btcore.TreeNode] | str = request.param
    return getattr(acceptance_script("proof_plugins"), cls) if isinstance(cls, str) else cls


def answer_about(decorator: type[btcore.TreeNode], body: str = "", question: str = QUESTION) -> Answer:
    """Return the answer about a tree in which *decorator* decides between Left and Right."""
    name = decorator.__name__
    body = body or f"<{name} name='it'><AlwaysSuccess/></{name}>"
    tree = f"""<KeepRunningUntilFailure><ForceSuccess>
        <Sequence>
            <Fallback> <Ready/> <Ready/> </Fallback>
            <IfThenElse> {body} <Left/> <Right/> </IfThenElse>
        </Sequence>
    </ForceSuccess></KeepRunningUntilFailure>"""
    return answer_about_tree(decorator, tree, question)


def answer_about_tree(decorator: type[btcore.TreeNode], tree: str, question: str) -> Answer:
    """Return the answer about a whole tree."""
    return answers_of(prover_of(tree, question, leaves=(Ready, Left, Right, Sense, decorator)))[question]


class Decorator(btcore.DecoratorNode):
    """Ticks its child, and then returns what `decide` returns."""

    spec = NodeSpec(state_fields=())

    def tick(self) -> Status:
        """Tick the child."""
        self.child.execute_tick()
        return SUCCESS if self.decide() else FAILURE

    def decide(self) -> bool:
        """Return whether to succeed."""
        return True


class Elapsed(Decorator):
    """Reads the clock, and keeps a start time."""

    spec = NodeSpec(state_fields=("start",))
    start = 0

    def decide(self) -> bool:
        self.start = self.start or self.now()
        return self.now() - self.start < 5 * NS_PER_S


class ElapsedByBlackboard(Elapsed):
    """Reads the clock of the blackboard, and keeps a start time."""

    def decide(self) -> bool:
        self.start = self.start or self.blackboard.now()
        return self.blackboard.now() - self.start < 5 * NS_PER_S


class HidesNow(Decorator):
    """Has a port that hides `now`, and reads the clock nevertheless."""

    now: btcore.In[str] = "port"  # type: ignore[assignment]

    def decide(self) -> bool:
        return btcore.TreeNode.now(self) >= 0


class StartInTimeFields(Elapsed):
    """Declares a start time as a deadline."""

    spec = NodeSpec(time_fields=("start",))


class ComparesNow(Elapsed):
    """Compares a deadline with a time that may be later than the start of the tick."""

    spec = NodeSpec(time_fields=("start",))

    def decide(self) -> bool:
        self.start = self.start or self.now() + 5 * NS_PER_S
        return self.now() < self.start


class Absolute(Decorator):
    """Compares the time with a constant."""

    def decide(self) -> bool:
        return self.now() < 10**19


class KeepsClock(Decorator):
    """Gets the clock."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock


class Chance(Decorator):
    """Uses random numbers, by a function that its module imports."""

    def decide(self) -> bool:
        return choice([True, True])


class SeededChance(Decorator):
    """Uses the random numbers of a variable of its module."""

    def decide(self) -> bool:
        return GENERATOR.random() < 2


class GlobalList(Decorator):
    """Counts in a list of its module."""

    def decide(self) -> bool:
        LOG.append(1)
        return len(LOG) < 1000


class OfClass(Decorator):
    """Counts in an attribute of its class."""

    count = 0

    def decide(self) -> bool:
        OfClass.count += 1
        return OfClass.count < 1000


class UndeclaredSteps(Decorator):
    """Keeps a generator in an attribute that is no state field."""

    def __init__(self) -> None:
        self.steps = (True for _ in count())

    def decide(self) -> bool:
        return next(self.steps)


class Writes(Decorator):
    """Counts the writes of an entry."""

    value: btcore.In[Any]
    spec = NodeSpec(state_fields=("seen",))
    seen = 0

    def decide(self) -> bool:
        entry = self.blackboard.find("u")
        before, self.seen = self.seen, 0 if entry is None else entry.sequence_id
        return before == self.seen or self.seen < 3


class Returns(btcore.DecoratorNode):
    """Returns whatever its child raises."""

    spec = NodeSpec(state_fields=())

    def tick(self) -> Status:
        try:
            return self.child.execute_tick()
        finally:
            return SUCCESS  # noqa: B012, SIM107


class Remembers(Decorator):
    """Compares a value with the value before, as items of tuples."""

    value: btcore.In[Any]
    spec = NodeSpec(state_fields=("before",))
    before: tuple[Any, ...] = ()

    def decide(self) -> bool:
        before, self.before = self.before, (self.value,)
        return not before or before == self.before


WRITTEN = '<Sequence><ForceSuccess><Sense value="{u}"/></ForceSuccess>{}</Sequence>'
ADDS = "<{0} name='it'><ScriptCondition code='u + 1 &gt; 3'/></{0}>"


@pytest.mark.parametrize(
    ("decorator", "body", "reason"),
    [
        (Elapsed, "", "reads the clock, but its class declares no deadline in time_fields"),
        (ElapsedByBlackboard, "", "has another 'start'"),
        (HidesNow, "", "has a port called 'now', which hides its readings of the clock"),
        (Absolute, "", "reads the clock"),
        (KeepsClock, "", "keeps the clock"),
        ("UserWall", "", "calls time.monotonic, which the search cannot repeat"),
        (Chance, "", "calls random.choice"),
        (SeededChance, "", "the variable 'GENERATOR' of tests.tools.btcore_proof.test_user_code changes"),
        ("UserGlobal", "", "the variable '_calls' of acceptance_proof_plugins changes"),
        (GlobalList, "", "the variable 'LOG' of tests.tools.btcore_proof.test_user_code changes"),
        (OfClass, "", "the attribute 'count' of the class OfClass changes"),
        ("UserUndeclared", "", "the attribute 'calls' of 'it' <UserUndeclared> changes"),
        ("UserSteps", "", "keeps a generator in 'steps', which cannot be copied and compared"),
        (UndeclaredSteps, "", "keeps a generator in 'steps', which cannot be copied and compared"),
        (Writes, WRITTEN, "has another result"),
        ("UserSwallow", WRITTEN.replace("{}", ADDS), "the value of {u} is not known"),
        (Returns, WRITTEN.replace("{}", ADDS), "the value of {u} is not known"),
        ("UserCatch", WRITTEN, "the value of {u} is not known"),
        (Remembers, WRITTEN, "keeps an unknown value in 'before'"),
    ],
    indirect=["decorator"],
)
def test_code_that_the_search_cannot_repeat_makes_the_answer_unknown(
    decorator: type[btcore.TreeNode], body: str, reason: str
) -> None:
    name = decorator.__name__
    port = " value='{u}'" if "value" in get_annotations(decorator) else ""
    inner = f"<{name} name='it'{port}><AlwaysSuccess/></{name}>"
    body = body.replace("{0}", name).replace("{}", inner)
    answer = answer_about(decorator, body)
    assert answer.answer == UNKNOWN_ANSWER
    assert reason in answer.detail
    if "value of" not in reason and "the variable" not in reason and "of the class" not in reason:
        assert f"it' <{name}>" in answer.detail


@pytest.mark.parametrize("decorator", ["UserUndeclared"], indirect=True)
def test_a_run_whose_timers_are_not_repeated_is_not_shown(decorator: type[btcore.TreeNode]) -> None:
    tree = "<UserUndeclared><Delay name='wait' delay_msec='9'><Left/></Delay></UserUndeclared>"
    answer = answer_about_tree(decorator, tree, "wait leads to Left is FAILURE within 1 ticks")
    assert answer.answer == UNKNOWN_ANSWER


@pytest.mark.parametrize("decorator", ["UserSwallow", Returns], indirect=True)
def test_caught_interrupt_changing_no_decision_makes_answer_unknown(
    decorator: type[btcore.TreeNode],
) -> None:
    inner = ADDS.format(decorator.__name__)
    sequence = f"<ForceSuccess>{WRITTEN.replace('{}', inner)}</ForceSuccess>"
    body = f"<KeepRunningUntilFailure>{sequence}</KeepRunningUntilFailure>"
    answer = answer_about(decorator, body, "never it is FAILURE")
    assert answer.answer == UNKNOWN_ANSWER
    assert f"<{decorator.__name__}> catches an exception with which the search ends a tick" in answer.detail


class Plain(Decorator):
    """Keeps nothing."""


class Nested(Decorator):
    """Fails in every third tick, and counts in a list within a tuple, whose items nothing else shows."""

    spec = NodeSpec(state_fields=("last",))
    last: tuple[str, list[float]]

    def __init__(self) -> None:
        self.last = ("", [-0.0])

    def decide(self) -> bool:
        self.last[1].append(0.0)
        del self.last[1][3:]
        return len(self.last[1]) < 3


class StateMachine(Decorator):
    """Keeps the method that decides next, and compares with a constant of its module."""

    spec = NodeSpec(state_fields=("last", "step"))

    def __init__(self) -> None:
        self.step: Callable[[], bool] = self.first
        self.last = MISSING

    def decide(self) -> bool:
        return self.step()

    def first(self) -> bool:
        """Go on to the second step."""
        self.step = self.second
        return self.last is MISSING

    def second(self) -> bool:
        """Stay."""
        return False


class Within(Decorator):
    """Succeeds for one second."""

    spec = NodeSpec(state_fields=("end",), time_fields=("end",))
    end = 0

    def decide(self) -> bool:
        self.end = self.end or self.now() + NS_PER_S
        return not self.has_passed(self.end)


class Catches(Decorator):
    """Catches the exceptions of its child, and no other exceptions."""

    def tick(self) -> Status:
        """Tick the child."""
        try:
            return self.child.execute_tick()
        except Exception:
            return FAILURE


class Compares(Decorator):
    """Compares a known value."""

    value: btcore.In[int]

    def decide(self) -> bool:
        return self.value < 3


class ReadsByKey(Decorator):
    """Reads an entry without a port."""

    def decide(self) -> bool:
        return "written" not in self.blackboard


RAISES = "<Catches name='it'><ScriptCondition code='unwritten &gt; 3'/></Catches>"
KNOWN = "<Sequence><Script code='u := 4'/>{}</Sequence>"


@pytest.mark.parametrize(
    ("decorator", "body", "expected"),
    [
        (Plain, "", PROVED),
        ("UserMemory", "", REFUTED),
        (Nested, "", REFUTED),
        (StateMachine, "", REFUTED),
        (Within, "", REFUTED),
        (Catches, RAISES, REFUTED),
        (Compares, KNOWN, REFUTED),
        (ReadsByKey, WRITTEN.replace("{u}", "{written}"), REFUTED),
    ],
    indirect=["decorator"],
)
def test_code_whose_state_is_declared_is_searched(
    decorator: type[btcore.TreeNode], body: str, expected: str
) -> None:
    port = " value='{u}'" if "value" in get_annotations(decorator) else ""
    inner = f"<{decorator.__name__} name='it'{port}><AlwaysSuccess/></{decorator.__name__}>"
    answer = answer_about(decorator, body.replace("{}", inner))
    assert (answer.answer, answer.detail) == (expected, "")


@pytest.mark.parametrize("decorator", [StartInTimeFields, ComparesNow])
def test_code_that_compares_time_within_tick_makes_answer_unknown(
    decorator: type[btcore.TreeNode],
) -> None:
    answer = answer_about(decorator, question="never Left & Right")
    assert answer.answer == UNKNOWN_ANSWER
    assert "compares the time of now(): use has_passed()" in answer.detail
