"""Which setting of a file means which field of a server's parameters, and whether its value will do."""

from collections.abc import Iterator
from dataclasses import Field, fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final, TypeVar

from btcore_robot.navigation.parameter_files import Setting, Settings

SPELLINGS: Final = "spellings"
"""The key of a field's metadata under which its other names in parameter files stand."""
LOW: Final = "low"
"""The key of a field's metadata for the least value that makes sense."""

_PLUGINS: Final = (
    "FollowPath",
    "GridBased",
    "progress_checker",
    "goal_checker",
    "general_goal_checker",
    "static_layer",
    "obstacle_layer",
    "voxel_layer",
    "inflation_layer",
    "scan",
)
_NEAR: Final = 0.84  # how alike (difflib's ratio) a key must be to one that is known to be taken for a slip
_SILENT: Final = frozenset({"plugin", "enabled", "use_sim_time"})
_LISTS: Final = ("plugins", "filters", "observation_sources")
_LISTING: Final = ("_plugin", "_plugins")  # how keys end whose values are ids
_NAV2: Final = frozenset(
    [
        *(
            "acc_lim_y",
            "decel_lim_y",
            "max_vel_y",
            "min_vel_y",
            "max_speed_xy",
            "min_speed_xy",
            "min_speed_theta",
        ),
        *("vy_max", "vy_min", "ay_max", "ay_min", "az_min", "vy_samples", "vx_std", "wz_std", "z_resolution"),
        *("angular_granularity", "base_frame", "robot_base_frame", "global_frame", "local_frame"),
        *("min_x_velocity_threshold", "max_obstacle_height", "footprint_topic", "transform_tolerance", "z"),
    ]
)
"""Keys of Nav2 that are no slip of a known one, however like it they look."""

_WORDS: Final = {
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "str": "a text",
    "tuple[str, ...]": "a list of texts",
}

Parameters = TypeVar("Parameters")


class ParameterOverlay:
    """Lays the settings of one server over its parameters *plain*, and notes what doesn't fit."""

    def __init__(self, path: Path, plain: Any) -> None:
        self._path = path
        self._plain = plain
        self._fields: dict[str, Field[Any]] = {}
        for one in fields(plain):
            for name in (one.name, *one.metadata.get(SPELLINGS, ())):
                self._fields[name] = one
        self.mistakes: list[str] = []
        """A sentence for each value that won't do."""
        self.slips: list[str] = []
        """A sentence for each key that was probably meant to be another."""
        self.unknown: dict[str, object] = {}
        """What no field is for, by full name."""

    def apply(self, settings: Settings) -> Any:
        """The parameters with *settings* over them; of several plug-ins the first one listed counts."""
        ranks = {name: rank for rank, name in enumerate(_ids(settings))}
        chosen: dict[str, tuple[int, object]] = {}
        for name, setting in settings.items():
            key, rank = _bare(name, ranks)
            one = self._fields.get(key)
            if one is None:
                self._miss(key, setting)
                continue
            value = self._value(one, setting)
            if value is not None and (one.name not in chosen or rank < chosen[one.name][0]):
                chosen[one.name] = rank, value
        return replace(self._plain, **{name: value for name, (_, value) in chosen.items()})

    def _miss(self, key: str, setting: Setting) -> None:
        last = key.rsplit(".", 1)[-1]
        if last in _SILENT or last in _LISTS or last.endswith(_LISTING):
            return
        self.unknown[setting.name] = setting.value
        near = get_close_matches(key, self._fields, n=1, cutoff=_NEAR)
        if near and last not in _NAV2:
            self.slips.append(
                f"{self._path}, line {setting.line}: {setting.name} has no effect; did you mean {near[0]}?"
            )

    def _value(self, one: Field[Any], setting: Setting) -> object:
        kind = one.type if isinstance(one.type, str) else getattr(one.type, "__name__", str(one.type))
        kind = "tuple[str, ...]" if kind.startswith("tuple") else kind
        value = _read(kind, setting.value)
        place = f"{self._path}, line {setting.line}: {setting.name}"
        if value is None:
            self.mistakes.append(f"{place} is {setting.value!r}, and {_WORDS[kind]} is expected")
            return None
        low = one.metadata.get(LOW)
        if low is not None and isinstance(value, int | float) and not value >= low:
            self.mistakes.append(f"{place} is {setting.value!r}, and {low:g} is the least that makes sense")
            return None
        return value


def _read(kind: str, value: object) -> object:
    """*value* as the type that *kind* names, or None. YAML 1.1 takes 1e-3 for a text; ROS and we don't."""
    if kind == "bool":
        return value if isinstance(value, bool) else None
    if kind == "tuple[str, ...]":
        texts = isinstance(value, list) and all(isinstance(one, str) for one in value)
        return tuple(value) if texts and isinstance(value, list) else None
    if isinstance(value, bool):
        return None
    if kind == "int":
        return value if isinstance(value, int) else None
    if kind == "str":
        return value if isinstance(value, str) else None
    if isinstance(value, str) and value[:1] in "+-.0123456789" and "e" in value.lower():
        try:
            return float(value)
        except ValueError:
            return None
    return float(value) if isinstance(value, int | float) else None


def _ids(settings: Settings) -> Iterator[str]:
    """The ids of a server's plug-ins and sensors, those that the file lists first."""
    for name, setting in settings.items():
        last = name.rsplit(".", 1)[-1]
        if last in _LISTS or last.endswith(_LISTING):
            listed = setting.value if isinstance(setting.value, list) else str(setting.value).split()
            yield from (str(one) for one in listed)
    yield from _PLUGINS


def _bare(name: str, ranks: dict[str, int]) -> tuple[str, int]:
    """*name* without the ids of plug-ins in front, and the rank of the first of them (-1 for none)."""
    rank = -1
    first, dot, rest = name.partition(".")
    while dot and first in ranks:
        rank = max(rank, ranks[first])
        name = rest
        first, dot, rest = name.partition(".")
    return name, rank
