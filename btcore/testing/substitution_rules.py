"""TestNode and its settings, and substitution rules from JSON, as BehaviorTree.CPP has them.

nodes.substitute("Patrol/*", TestNodeConfig(return_status=Status.FAILURE, async_delay=100))
load_substitution_rules(nodes, Path("rules.json"))
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Final

from btcore.clock import NS_PER_MS
from btcore.engine.context import TreeContext
from btcore.engine.leaf import StatefulAction
from btcore.engine.node import TreeNode
from btcore.engine.node_config import NodeConfig
from btcore.errors import BtcoreError, NodeError, ScriptError
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.script.program import Program, compile_script
from btcore.status import FAILURE, IDLE, RUNNING, SUCCESS, Status
from btcore.suggestions import join_names, nearest_name
from btcore.values import number_of

_STATUSES: Final = {status.name: int(status) for status in Status}


@dataclass(frozen=True, slots=True)
class TestNodeConfig:
    """What a :class:`TestNode` does.

    After *async_delay* milliseconds of the tree's clock (0 = in the first tick) its result is that of
    *complete_func*, else of *return_status_script*, which may use the names of the statuses, else
    *return_status*. Then *success_script* or *failure_script* runs, and *post_script*. A node whose
    result is RUNNING is asked again at the next tick. Raises ValueError for a result that is IDLE.
    """

    __test__: ClassVar[bool] = False

    return_status: Status = SUCCESS
    return_status_script: str = ""
    success_script: str = ""
    failure_script: str = ""
    post_script: str = ""
    async_delay: int = 0
    complete_func: Callable[[], Status] | None = None

    def __post_init__(self) -> None:
        if self.return_status is IDLE:
            raise ValueError("the result of a TestNode can't be IDLE: that is what a node is before a tick")

    def manifest(self) -> Manifest:
        """What makes the nodes, for :meth:`Registry.substitute`."""
        return _Made(self)


class TestNode(StatefulAction):
    """Stands in for a node of a tree, and does what its :class:`TestNodeConfig` says."""

    __test__: ClassVar[bool] = False

    def __init__(self, settings: TestNodeConfig) -> None:
        self.settings = settings
        self.until = 0
        names = {**self.config.enums, **_STATUSES}
        self.result = self._compiled("return_status_script", names)
        self.scripts = {
            SUCCESS: self._compiled("success_script", self.config.enums),
            FAILURE: self._compiled("failure_script", self.config.enums),
        }
        self.post = self._compiled("post_script", self.config.enums)

    def on_start(self) -> Status:
        """Begin to wait, or end at once."""
        delay = self.settings.async_delay * NS_PER_MS
        if delay <= 0:
            return self._complete()
        self.until = self.now() + delay
        self.wake_at(self.until)
        return RUNNING

    def on_running(self) -> Status:
        """Look at the clock."""
        return RUNNING if self.now() < self.until else self._complete()

    def on_halted(self) -> None:
        """Wait no more."""
        self.cancel_wake_up()

    def _compiled(self, setting: str, names: Mapping[str, int]) -> Program | None:
        text = getattr(self.settings, setting)
        try:
            return compile_script(text, names) if text else None
        except ScriptError as fault:
            raise NodeError(f"the {setting} of the TestNode for '{self.path}': {fault}") from None

    def _complete(self) -> Status:
        status = self._answer()
        follows = self.scripts.get(status)
        if follows is not None:
            follows.run(self.blackboard)
        if self.post is not None:
            self.post.run(self.blackboard)
        return status

    def _answer(self) -> Status:
        if self.settings.complete_func is not None:
            return self.settings.complete_func()
        if self.result is None:
            return self.settings.return_status
        value = self.result.run(self.blackboard)
        if isinstance(value, str) and value in _STATUSES:
            return Status[value]
        number = None if isinstance(value, str) else number_of(value)
        if number is None or number not in _STATUSES.values():
            raise NodeError(
                f"the return_status_script gives {value!r}, which is no status: "
                f"{join_names(_STATUSES, 'or')}, or its number"
            )
        return Status(int(number))


class _Made(Manifest):
    """Makes the test nodes of one rule. They take the ports of the node that they stand in for."""

    def __init__(self, settings: TestNodeConfig) -> None:
        super().__init__("TestNode", TestNode, (), (), "btcore")
        self._settings = settings

    def make(
        self,
        config: NodeConfig,
        context: TreeContext,
        blackboard: Any,
        resources: Sequence[object],
        children: list[TreeNode],
    ) -> TreeNode:
        """A test node."""
        node = TestNode.__new__(TestNode)
        node.attach_to_tree(config, context, blackboard)
        TestNode.__init__(node, self._settings)
        return node


# --- from JSON

_KEYS: Final = tuple(field.name for field in fields(TestNodeConfig) if field.name != "complete_func")


class SubstitutionError(BtcoreError):
    """Substitution rules that can't be read as such."""


def load_substitution_rules(nodes: Registry, rules: str | Path) -> None:
    """Give *nodes* the rules in *rules*: JSON text, or the path of a file of it.

    An object with ``SubstitutionRules``, which maps filters to the name of a configuration or else the
    ID of a registered node, and perhaps ``TestNodeConfigs``, which maps names to the settings of
    :class:`TestNodeConfig`. Raises SubstitutionError, and then *nodes* has none of the rules.
    """
    text = rules.read_text(encoding="utf-8") if isinstance(rules, Path) else rules
    try:
        read = json.loads(text)
    except ValueError as fault:
        raise SubstitutionError(f"the substitution rules are no JSON: {fault}") from None
    top = _object(read, "the substitution rules")
    if "SubstitutionRules" not in top:
        raise SubstitutionError("the substitution rules lack the object 'SubstitutionRules'")
    given = _object(top.get("TestNodeConfigs", {}), "'TestNodeConfigs'")
    configs = {name: _config(name, one) for name, one in given.items()}
    wanted = _object(top["SubstitutionRules"], "'SubstitutionRules'")
    for filter, by in wanted.items():
        if not isinstance(by, str):
            raise SubstitutionError(
                f"the rule '{filter}' names a configuration or a node's ID, but it is {by!r}"
            )
    for filter, by in wanted.items():
        nodes.substitute(filter, configs.get(by, by))


def _object(value: object, what: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise SubstitutionError(f"{what} must be an object {{…}}, not {value!r}")
    return value


def _config(name: str, given: object) -> TestNodeConfig:
    settings = _object(given, f"the configuration '{name}'")
    for key, value in settings.items():
        if key not in _KEYS:
            guess = nearest_name(key, _KEYS)
            hint = f"did you mean '{guess}'?" if guess else f"there are {join_names(_KEYS)}"
            raise SubstitutionError(f"the configuration '{name}' has '{key}', which is no setting; {hint}")
        wanted, kind = (int, "a number of milliseconds") if key == "async_delay" else (str, "a text")
        if not isinstance(value, wanted) or isinstance(value, bool):
            raise SubstitutionError(f"'{key}' of the configuration '{name}' is {kind}, not {value!r}")
    status = settings.get("return_status")
    if status is None and "return_status_script" not in settings:
        raise SubstitutionError(
            f"the configuration '{name}' needs 'return_status', 'return_status_script', or both"
        )
    if status is not None and (status == "IDLE" or status not in _STATUSES):
        allowed = [one for one in _STATUSES if one != "IDLE"]
        raise SubstitutionError(
            f"'return_status' of the configuration '{name}' is {join_names(allowed, 'or')}, not {status!r}"
        )
    if status is None:
        return TestNodeConfig(**settings)
    return TestNodeConfig(**{**settings, "return_status": Status[status]})
