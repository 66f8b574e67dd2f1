"""Parameters of a process: declared with a default, set at its start, from a file or by hand."""

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TypeVar, cast

from btcore_robot.navigation.parameter_files import EVERY_SERVER, ParameterError, read_settings

__all__ = ["ParameterError", "Parameters", "Value", "parameters_of"]

USE_SIM_TIME = "use_sim_time"
"""What every node of ROS 2 has; here time is always that of the robot."""

Value = bool | int | float | str | list[int] | list[float] | list[str]
Declared = TypeVar("Declared", bool, int, float, str, list[int], list[float], list[str])

_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text", list: "a list"}


class Parameters:
    """The parameters of the process called *owner*, of which *given* were set from outside."""

    def __init__(self, owner: str, given: Mapping[str, Value]) -> None:
        self._owner = owner
        self._given = dict(given)
        self._values: dict[str, Value] = {}

    def declare(self, name: str, default: Declared) -> Declared:
        """The value of *name*: what was given, else *default*, whose type it has.

        Raises ParameterError for a value of another type; a whole number will do for a float.
        """
        value = self._given.get(name, default)
        if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if type(value) is not type(default):
            raise ParameterError(
                f"{self._owner}: the parameter '{name}' is {value!r}, "
                f"and {_WORDS[type(default)]} is expected, such as {default!r}"
            )
        if isinstance(value, list) and isinstance(default, list):
            self._check_items(name, value, default)
        self._values[name] = value
        # mypy checks this once a type that Declared may be, and can't follow the line above.
        return value  # type: ignore[return-value,unused-ignore]

    def __getitem__(self, name: str) -> Value:
        """The value of a declared parameter. Raises KeyError."""
        return self._values[name]

    def unused(self) -> Iterator[str]:
        """A sentence for every parameter that was given but never declared."""
        for name in self._given:
            if name not in self._values and name != USE_SIM_TIME:
                near = get_close_matches(name, self._values, 1)
                hint = f"; did you mean '{near[0]}'?" if near else ""
                yield f"the parameter '{name}' is none of {self._owner}'s, and does nothing{hint}"

    def _check_items(self, name: str, value: Sequence[object], default: Sequence[object]) -> None:
        kinds = {type(one) for one in value}
        wanted = {type(one) for one in default}
        if len(kinds) > 1 or (wanted and kinds and kinds != wanted):
            raise ParameterError(
                f"{self._owner}: the parameter '{name}' is {value!r}, and its items are to be of one type, "
                f"as in {default!r}"
            )


def parameters_of(path: Path, name: str) -> dict[str, Value]:
    """What the parameter file at *path* says of the process *name*, and of all (``/**``) before it.

    Raises ParameterError where the file can't be read, or holds what no parameter can be.
    """
    servers = read_settings(path)
    found: dict[str, Value] = {}
    for owner in (EVERY_SERVER, name):
        for key, setting in servers.get(owner, {}).items():
            value = setting.value
            if isinstance(value, list):
                fine = all(isinstance(one, bool | int | float | str) for one in value)
            else:
                fine = isinstance(value, bool | int | float | str)
            if not fine:
                raise ParameterError(
                    f"{path}, line {setting.line}: '{key}' is {value!r}, and a parameter is a number, "
                    "a text, true or false, or a list of them"
                )
            found[key] = cast(Value, value)
    return found
