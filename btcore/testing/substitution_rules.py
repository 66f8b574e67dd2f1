"""Substitution of nodes in tests: BehaviorTree.CPP's TestNode, and substitution rules in JSON.

Rules are set in code or read from a file:

    nodes.substitute("Patrol/*", TestNodeConfig(return_status=FAILURE, async_delay=100))
    load_substitution_rules(nodes, Path("rules.json"))
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Final, Literal

from msgspec import Struct, field, to_builtins

from btcore.clock import NS_PER_MS
from btcore.engine.leaf import StatefulAction
from btcore.engine.node import read_clock
from btcore.errors import BtcoreError, NodeError, ScriptError
from btcore.input_files import read_file
from btcore.json_text import load_json
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.script.program import Program, compile_script
from btcore.status import FAILURE, IDLE, RUNNING, SUCCESS, Status
from btcore.suggestions import join_names
from btcore.typed_data import DataError, Record, convert
from btcore.values import number_of

_STATUSES: Final = {status.name: int(status) for status in Status}


@dataclass(frozen=True, slots=True)
class TestNodeConfig:
    """The configuration of a `TestNode`.

    Attributes:
        return_status: The result. After the result RUNNING, the next tick determines the result again.
        return_status_script: A script whose value is the result, instead of *return_status*. It may use the
            names of the statuses, such as FAILURE.
        success_script: A script that runs on SUCCESS.
        failure_script: A script that runs on FAILURE.
        post_script: A script that runs on any result, after *success_script* or *failure_script*.
        async_delay: The delay of the result (ms of the tree's clock); without a delay (0), the first tick
            returns the result.
        complete_func: A function that returns the result. It takes precedence over *return_status_script*.

    Raises:
        ValueError: *return_status* is IDLE.

    Examples:
        >>> import btcore
        >>> from btcore.testing import TestNodeConfig
        >>> nodes = btcore.Registry.standard()
        >>> b = btcore.Builder(nodes)
        >>> nodes.substitute("door", TestNodeConfig(return_status=btcore.FAILURE))
        >>> b.build(b.AlwaysSuccess(name="door")).tick_once()
        <Status.FAILURE: 3>
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
            raise ValueError("the result of a TestNode cannot be IDLE, which is the status before a tick")

    def manifest(self) -> Manifest:
        """Return a manifest that creates the replacement nodes, for `Registry.substitute`."""
        return Manifest("TestNode", type("TestNode", (TestNode,), {"settings": self}), (), (), "btcore")


class TestNode(StatefulAction):
    """A leaf that replaces a node of a tree, and returns the results of its `TestNodeConfig`.

    Attributes:
        settings: The configuration.
        until: The time (ns) at which the delay ends.
        result: The compiled script that returns the result, if any.
        scripts: The compiled scripts of SUCCESS and FAILURE.
        post: The compiled script that runs after every result, if any.
    """

    __test__: ClassVar[bool] = False

    settings: ClassVar[TestNodeConfig]

    def __init__(self) -> None:
        self.until = 0
        names = {**self.config.enums, **_STATUSES}
        self.result = self._compile("return_status_script", names)
        self.scripts = {
            SUCCESS: self._compile("success_script", self.config.enums),
            FAILURE: self._compile("failure_script", self.config.enums),
        }
        self.post = self._compile("post_script", self.config.enums)

    def on_start(self) -> Status:
        """Start the delay, or complete immediately without a delay."""
        delay = self.settings.async_delay * NS_PER_MS
        if delay <= 0:
            return self._complete()
        self.until = read_clock(self) + delay
        self.wake_at(self.until)
        return RUNNING

    def on_running(self) -> Status:
        """Complete when the delay has elapsed."""
        return self._complete() if self.has_passed(self.until) else RUNNING

    def on_halted(self) -> None:
        """Cancel the delay."""
        self.cancel_wake_up()

    def _compile(self, setting: str, names: Mapping[str, int]) -> Program | None:
        text = getattr(self.settings, setting)
        try:
            return compile_script(text, names) if text else None
        except ScriptError as error:
            raise NodeError(f"the {setting} of the TestNode for '{self.config.path}': {error}") from None

    def _complete(self) -> Status:
        status = self._determine_result()
        for script in (self.scripts.get(status), self.post):
            if script is not None:
                script.run(self._blackboard)
        return status

    def _determine_result(self) -> Status:
        if self.settings.complete_func is not None:
            return self.settings.complete_func()
        if self.result is None:
            return self.settings.return_status
        value = self.result.run(self._blackboard)
        if isinstance(value, str) and value in _STATUSES:
            return Status[value]
        number = None if isinstance(value, str) else number_of(value)
        if number is None or number not in _STATUSES.values():
            raise NodeError(
                f"the return_status_script returns {value!r}, which is not a status: use "
                f"{join_names(_STATUSES, 'or')}, or its number"
            )
        return Status(int(number))


class _Config(Record, omit_defaults=True):
    return_status: Literal["RUNNING", "SUCCESS", "FAILURE", "SKIPPED"] | None = None
    return_status_script: str = ""
    success_script: str = ""
    failure_script: str = ""
    post_script: str = ""
    async_delay: int = 0

    def __post_init__(self) -> None:
        if self.return_status is None and not self.return_status_script:
            raise ValueError("needs 'return_status', 'return_status_script', or both")

    def test_node_config(self) -> TestNodeConfig:
        settings = to_builtins(self)
        return TestNodeConfig(**{**settings, "return_status": Status[self.return_status or "SUCCESS"]})


class _Rules(Struct):
    rules: dict[str, str] = field(name="SubstitutionRules")
    configs: dict[str, _Config] = field(name="TestNodeConfigs", default_factory=dict)


class SubstitutionError(BtcoreError):
    """Raised when substitution rules are invalid."""


def load_substitution_rules(nodes: Registry, rules: str | Path) -> None:
    """Add substitution rules to a registry.

    The rules are a JSON object with the key `SubstitutionRules`, which maps each filter (see
    `Registry.substitute`) to the name of a configuration or to the ID of a registered node. The
    optional key `TestNodeConfigs` maps the names of configurations to the settings of a
    `TestNodeConfig`.

    Args:
        nodes: The registry.
        rules: The JSON text, or the path of a JSON file.

    Raises:
        SubstitutionError: The rules are invalid; none of them is added.
        OSError: The file cannot be read.

    Examples:
        >>> import btcore
        >>> from btcore.testing import load_substitution_rules
        >>> nodes = btcore.Registry.standard()
        >>> load_substitution_rules(nodes, '{"SubstitutionRules": {"door": "AlwaysFailure"}}')
        >>> b = btcore.Builder(nodes)
        >>> b.build(b.AlwaysSuccess(name="door")).tick_once()
        <Status.FAILURE: 3>
    """
    try:
        text = read_file(rules).decode() if isinstance(rules, Path) else rules
        given = convert(load_json(text), _Rules)
    except UnicodeDecodeError:
        raise SubstitutionError("the substitution rules are not text in UTF-8") from None
    except DataError as error:
        raise SubstitutionError(f"the substitution rules: {error}") from None
    except ValueError as error:
        raise SubstitutionError(f"the substitution rules are not valid JSON: {error}") from None
    configs = {name: config.test_node_config() for name, config in given.configs.items()}
    for filter, name in given.rules.items():
        nodes.substitute(filter, configs.get(name, name))
