"""Parameters of a component: it declares them with a default; files or options set them at its start."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar, cast

from btcore.suggestions import did_you_mean
from btcore.typed_data import DataError, convert
from btcore_robot.parameter_files import EVERY_SERVER, read_settings
from btcore_robot.parameter_files import ParameterError as ParameterError

USE_SIM_TIME = "use_sim_time"
"""A parameter of every ROS 2 node; it has no effect here, because time is always the robot's time."""

ParameterValue = bool | int | float | str | list[int] | list[float] | list[str]
"""The value of a parameter."""

DeclaredValue = TypeVar("DeclaredValue", bool, int, float, str, list[int], list[float], list[str])


class Parameters:
    """The parameters of the component named *owner*. *set_at_start* contains the values set at its start."""

    def __init__(self, owner: str, set_at_start: Mapping[str, ParameterValue]) -> None:
        self._owner = owner
        self._given = dict(set_at_start)
        self._values: dict[str, ParameterValue] = {}

    def declare(self, name: str, default: DeclaredValue) -> DeclaredValue:
        """Declare the parameter *name* and return its value: the given value, or else *default*.

        Args:
            name: The name of the parameter.
            default: The default value, which also determines the type.

        Raises:
            ParameterError: The given value has another type (a whole number is accepted for a float).
        """
        value = default
        if name in self._given:
            try:
                value = convert(self._given[name], type(default))
            except DataError as error:
                problem = f"the parameter '{name}' {error.problem}, such as {default!r}"
                raise ParameterError(f"{self._owner}: {problem}") from None
        if isinstance(value, list) and isinstance(default, list):
            self._check_items(name, value, default)
        self._values[name] = value
        return value

    def __getitem__(self, name: str) -> ParameterValue:
        """Return the value of a declared parameter. Raises KeyError for any other name."""
        return self._values[name]

    def unused_warnings(self) -> Iterator[str]:
        """Yield a warning for every parameter that was given but never declared."""
        for name in self._given:
            if name not in self._values and name != USE_SIM_TIME:
                hint = did_you_mean(name, self._values)
                yield f"{self._owner} has no parameter '{name}', so its value is ignored{hint}"

    def _check_items(self, name: str, value: Sequence[object], default: Sequence[object]) -> None:
        types = {type(item) for item in value}
        expected_types = {type(item) for item in default}
        if len(types) > 1 or (expected_types and types and types != expected_types):
            raise ParameterError(
                f"{self._owner}: the parameter '{name}' is {value!r}, but its items must have the same type, "
                f"as in {default!r}"
            )


def load_component_parameters(path: Path, name: str) -> dict[str, ParameterValue]:
    """Return the parameters of a component in a file.

    The values under the component's name override the values for all components (`/**`).

    Args:
        path: The parameter file.
        name: The name of the component.

    Raises:
        ParameterError: The file cannot be read, or contains a value that is not a parameter.
    """
    servers = read_settings(path)
    parameters: dict[str, ParameterValue] = {}
    for owner in (EVERY_SERVER, name):
        for key, setting in servers.get(owner, {}).items():
            value = setting.value
            items = value if isinstance(value, list) else [value]
            if not all(isinstance(item, bool | int | float | str) for item in items):
                raise ParameterError(
                    f"{path}:{setting.line}: '{key}' is {value!r}, but a parameter is a number, "
                    "a text, true or false, or a list of them"
                )
            parameters[key] = cast(ParameterValue, value)
    return parameters
