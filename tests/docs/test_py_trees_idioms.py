"""The trees of the page for users of py_trees give the results of py_trees, tick by tick."""

import ast
import operator
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from btcore import Tree
from tests.docs.test_docs import program

py_trees = pytest.importorskip("py_trees")

PAGE = Path(__file__).parents[2] / "docs/guides/from_py_trees.md"
S, F, R = py_trees.common.Status.SUCCESS, py_trees.common.Status.FAILURE, py_trees.common.Status.RUNNING


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    """The names that the examples of the page define."""
    names: dict[str, Any] = {}
    exec(program(PAGE.read_text(encoding="utf-8")), names)
    return names


@pytest.fixture(autouse=True)
def _empty_blackboard() -> None:
    py_trees.blackboard.Blackboard.storage.clear()


def write(**entries: object) -> None:
    for key, value in entries.items():
        py_trees.blackboard.Blackboard.set(key, value)


def queue(name: str, *statuses: Any) -> Any:
    return py_trees.behaviours.StatusQueue(name, list(statuses), None)


def check(variable: str, value: object) -> Any:
    return py_trees.common.ComparisonExpression(variable, value, operator.eq)


def assert_same_results(tree: Tree, root: Any, steps: list[dict[str, object]]) -> list[str]:
    """Tick both trees after each of *steps*, the entries to write. Return the results."""
    results = []
    for number, entries in enumerate(steps):
        write(**entries)
        for key, value in entries.items():
            tree.blackboard[key] = value
        root.tick_once()
        assert tree.tick_once().name == root.status.name, f"tick {number + 1}"
        results.append(root.status.name[0])
    return results


def again(page: dict[str, Any], name: str) -> Tree:
    """Return the tree *name* of the page, in its initial state."""
    tree: Tree = eval(calls(PAGE.read_text(encoding="utf-8"))[name], page)
    return tree


def calls(text: str) -> dict[str, str]:
    """Return the expressions `tree_of(…)` of a page by the variables to which they are assigned."""
    return {
        statement.targets[0].id: ast.unparse(statement.value)
        for statement in ast.parse(program(text)).body
        if isinstance(statement, ast.Assign)
        and isinstance(statement.targets[0], ast.Name)
        and ast.unparse(statement.value).startswith("tree_of(")
    }


@pytest.mark.parametrize("joysticks", [[1, 2, 2, 2], [2, 1, 1, 1], [0, 1, 2, 0], [1, 1, 1, 2, 2]])
def test_either_or(page: dict[str, Any], joysticks: list[int]) -> None:
    root = py_trees.idioms.either_or(
        [check("joystick", 1), check("joystick", 2)], [queue("left", R, S), queue("right", R, S)]
    )
    assert_same_results(again(page, "either_or"), root, [{"joystick": value} for value in joysticks])


def test_pick_up_where_you_left_off(page: dict[str, Any]) -> None:
    root = py_trees.composites.Selector("root", memory=False)
    tasks = [queue("first", R, S), queue("second", R, S)]
    root.add_children(
        [queue("urgent", F, F, S, F), py_trees.idioms.pick_up_where_you_left_off("pick up", tasks)]
    )
    assert assert_same_results(again(page, "pick_up"), root, [{}] * 12)[:4] == ["R", "R", "S", "S"]


def test_oneshot(page: dict[str, Any]) -> None:
    root = py_trees.idioms.oneshot(queue("task", F, R, S))
    assert assert_same_results(again(page, "oneshot"), root, [{}] * 6) == ["F", "R", "S", "S", "S", "S"]


@pytest.mark.parametrize("statuses", [(R, S), (R, F), (S,), (F,)])
def test_oneshot_decorator(page: dict[str, Any], statuses: tuple[Any, ...]) -> None:
    policy = py_trees.common.OneShotPolicy.ON_COMPLETION
    root = py_trees.decorators.OneShot("once", queue("task", *statuses, R), policy)
    texts = ";".join(status.name for status in (*statuses, R))
    tree = page["tree_of"](f'<RunOnce then_skip="false"><StatusQueue queue="{texts}"/></RunOnce>')
    assert_same_results(tree, root, [{}] * 5)


def test_eternal_guard(page: dict[str, Any]) -> None:
    def allowed(blackboard: Any) -> bool:
        return bool(blackboard.allowed)

    root = py_trees.decorators.EternalGuard("guard", queue("task", R, R, S), allowed, {"allowed"})
    tree = page["tree_of"](
        '<ReactiveSequence><ScriptCondition code="allowed"/><StatusQueue queue="RUNNING;RUNNING;SUCCESS"/>'
        "</ReactiveSequence>"
    )
    assert_same_results(tree, root, [{"allowed": number % 3 != 1} for number in range(9)])


def test_for_each_needs_one_tick_less_than_a_loop(page: dict[str, Any]) -> None:
    write(rooms=["kitchen", "hall"])
    root = py_trees.decorators.ForEach("rooms", queue("task", S), "rooms", "room")
    tree = again(page, "for_each")
    expected = [tree.tick_once().name for _ in range(3)]
    seen = []
    while not seen or seen[-1] == "RUNNING":
        root.tick_once()
        seen.append(root.status.name)
    assert expected == ["RUNNING", *seen] == ["RUNNING", "RUNNING", "SUCCESS"]


BEHAVIOURS: dict[str, Callable[[], Any]] = {
    "every_third": lambda: py_trees.behaviours.SuccessEveryN("every third", 3),
    "periodic": lambda: queue("periodic", R, R, S, S, F, F),
}


@pytest.mark.parametrize("name", BEHAVIOURS)
def test_leaves(page: dict[str, Any], name: str) -> None:
    assert_same_results(again(page, name), BEHAVIOURS[name](), [{}] * 13)


def test_periodic_returns_each_status_for_one_tick_more_than_its_period(page: dict[str, Any]) -> None:
    root = py_trees.behaviours.Periodic("periodic", 1)
    tree = page["tree_of"]('<StatusQueue queue="SUCCESS;SUCCESS;FAILURE;FAILURE;RUNNING;RUNNING"/>')
    root.tick_once()  # only the first phase has the length of the period
    assert root.status is R
    assert_same_results(tree, root, [{}] * 13)


def test_wait_for_a_value(page: dict[str, Any]) -> None:
    expression = py_trees.common.ComparisonExpression("level", 3, operator.ge)
    root = py_trees.behaviours.WaitForBlackboardVariableValue("wait", expression)
    levels = [0, 2, 3, 1, 4, 5]
    results = assert_same_results(again(page, "wait_for_value"), root, [{"level": level} for level in levels])
    assert results == ["R", "R", "S", "R", "S", "S"]


def test_success_is_running(page: dict[str, Any]) -> None:
    root = py_trees.decorators.SuccessIsRunning("running", queue("task", S, R, F))
    tree = page["tree_of"](
        "<KeepRunningUntilFailure><StatusQueue queue='SUCCESS;RUNNING;FAILURE'/></KeepRunningUntilFailure>"
    )
    assert_same_results(tree, root, [{}] * 7)


LETTERS = {"S": S, "F": F, "R": R}
COMPOSITES: dict[str, Callable[[], Any]] = {
    "<Sequence>{}</Sequence>": lambda: py_trees.composites.Sequence("s", memory=True),
    "<ReactiveSequence>{}</ReactiveSequence>": lambda: py_trees.composites.Sequence("s", memory=False),
    "<Fallback>{}</Fallback>": lambda: py_trees.composites.Selector("s", memory=True),
    "<ReactiveFallback>{}</ReactiveFallback>": lambda: py_trees.composites.Selector("s", memory=False),
    '<Parallel success_count="-1">{}</Parallel>': lambda: py_trees.composites.Parallel(
        "p", policy=py_trees.common.ParallelPolicy.SuccessOnAll()
    ),
    '<Parallel success_count="1">{}</Parallel>': lambda: py_trees.composites.Parallel(
        "p", policy=py_trees.common.ParallelPolicy.SuccessOnOne()
    ),
}
DECORATORS: dict[str, Callable[[Any], Any]] = {
    "<Inverter>{}</Inverter>": lambda child: py_trees.decorators.Inverter("d", child),
    "<ForceSuccess>{}</ForceSuccess>": lambda child: py_trees.decorators.FailureIsSuccess("d", child),
    "<ForceFailure>{}</ForceFailure>": lambda child: py_trees.decorators.SuccessIsFailure("d", child),
}


def leaf_text(letters: str) -> str:
    return f'<StatusQueue queue="{";".join(LETTERS[letter].name for letter in letters)}"/>'


def leaf(letters: str) -> Any:
    return queue(letters, *(LETTERS[letter] for letter in letters))


@pytest.mark.parametrize("text", COMPOSITES)
@pytest.mark.parametrize("leaves", [("SRS", "RS", "SSRS"), ("RS", "S", "RRS"), ("F", "RF", "S")])
def test_composites_of_the_table(page: dict[str, Any], text: str, leaves: tuple[str, ...]) -> None:
    root = COMPOSITES[text]()
    root.add_children([leaf(letters) for letters in leaves])
    assert_same_results(page["tree_of"](text.format("".join(map(leaf_text, leaves)))), root, [{}] * 10)


@pytest.mark.parametrize("text", DECORATORS)
def test_decorators_of_the_table(page: dict[str, Any], text: str) -> None:
    tree = page["tree_of"](text.format(leaf_text("RSFRRF")))
    assert_same_results(tree, DECORATORS[text](leaf("RSFRRF")), [{}] * 10)
