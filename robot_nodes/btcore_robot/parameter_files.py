"""Parameter files of ROS 2: the settings of each server, and their mapping to the fields of a dataclass."""

from collections.abc import Iterator
from dataclasses import Field, dataclass, fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final, get_args, get_type_hints

import yaml

from btcore.suggestions import suggestion
from btcore.typed_data import DataError, convert
from btcore_robot.data_files import YamlLoader, read_text, yaml_errors
from btcore_robot.errors import RobotError

MARKER = "ros__parameters"
EVERY_SERVER = "**"
"""The wildcard name for all servers."""


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
_TYPO_RATIO: Final = 0.84  # similarity (difflib's ratio) to a known key from which a key counts as misspelt
_LISTS: Final = ("plugins", "observation_sources")
_LIST_ENDINGS: Final = ("_plugin", "_plugins")  # endings of keys whose values are ids
_NAV2: Final = frozenset(
    [
        *("acc_lim_y", "decel_lim_y", "max_vel_y", "min_vel_y"),
        *("max_speed_xy", "min_speed_xy", "min_speed_theta"),
        *("vy_max", "vy_min", "ay_max", "ay_min", "az_min", "vy_samples", "vx_std", "wz_std", "z_resolution"),
        *("angular_granularity", "base_frame", "robot_base_frame", "global_frame", "local_frame"),
        *("min_x_velocity_threshold", "max_obstacle_height", "footprint_topic", "transform_tolerance", "z"),
        *("alpha5", "raytrace_min_range", "width", "height", "track_unknown_space", "use_sim_time"),
        *("z_max", "z_short", "expected_planner_frequency", "default_server_timeout", "footprint_padding"),
    ]
)
"""Keys of Nav2 that are spelt correctly: they get no typo warning, even if they resemble a known key."""


class ParameterError(RobotError):
    """A parameter file can't be used; the message has a line for each mistake, with its place and reason."""


@dataclass(frozen=True, slots=True)
class Setting:
    """A setting of a file: the full *name* with the names of outer keys, the *value* and its *line*."""

    name: str
    value: object
    line: int


Settings = dict[str, Setting]
"""The settings of a server by their names within the server; dots join the keys of nested maps."""


def read_settings(path: Path) -> dict[str, Settings]:
    """Return the settings of each server in the file at *path*.

    The keys of the result are the servers' names without namespaces. A server's settings are below
    `amcl: ros__parameters:`, or directly below `amcl:` in files without `ros__parameters`. A namespace
    may be an outer map or part of the name (`/robot/amcl`). If a file has several maps for the same server,
    their settings are joined; later settings replace earlier settings.

    Raises:
        ParameterError: The file can't be read, or isn't YAML of this form.
    """
    text = read_text(path, "a YAML file of parameters", ParameterError)
    servers: dict[str, Settings] = {}
    with yaml_errors(path, ParameterError):
        root = yaml.compose(text, Loader=YamlLoader)
        if root is None:
            return servers
        if not isinstance(root, yaml.MappingNode):
            raise ParameterError(f"{path}:1: expected names of servers with parameters below them")
        constructor = YamlLoader("")
        for name, node in _servers(root, ""):
            line = node.start_mark.line + 1
            if not isinstance(node, yaml.MappingNode):
                raise ParameterError(
                    f"{path}:{line}: {name} must have parameters below it, not a single value"
                )
            settings = servers.setdefault(name, {})
            for setting_name, leaf in _leaves(node, ""):
                value = constructor.construct_object(leaf, deep=True)
                line = leaf.start_mark.line + 1
                settings[setting_name] = Setting(f"{name}.{setting_name}", value, line)
    return servers


def _servers(node: yaml.MappingNode, name: str) -> Iterator[tuple[str, yaml.Node]]:
    """Yield the name of every server below *node*, whose key is *name*, with the node of its parameters."""
    for key, child in node.value:
        word = str(key.value)
        if word == MARKER:
            yield name or EVERY_SERVER, child
            continue
        inner = word.rstrip("/").rsplit("/", 1)[-1]
        if isinstance(child, yaml.MappingNode) and _has_marker(child):
            yield from _servers(child, inner)
        elif not name:
            yield inner, child


def _has_marker(node: yaml.Node) -> bool:
    return isinstance(node, yaml.MappingNode) and any(
        key.value == MARKER or _has_marker(child) for key, child in node.value
    )


def _leaves(node: yaml.MappingNode, prefix: str) -> Iterator[tuple[str, yaml.Node]]:
    for key, child in node.value:
        name = f"{prefix}{key.value}"
        if isinstance(child, yaml.MappingNode) and child.value:
            yield from _leaves(child, f"{name}.")
        else:
            yield name, child


def aliases_of(annotation: Any) -> list[str]:
    """Return the other names of a parameter: the texts in its annotation, `Annotated[float, "vx_max"]`."""
    return [name for name in get_args(annotation)[1:] if isinstance(name, str)]


class ParameterOverlay:
    """Applies a file's settings to the default parameters of a server, and collects the problems."""

    def __init__(self, path: Path, defaults: Any) -> None:
        self._path = path
        self._defaults = defaults
        self._types = get_type_hints(type(defaults), include_extras=True)
        self._fields: dict[str, Field[Any]] = {}
        for field in fields(defaults):
            for name in (field.name, *aliases_of(self._types[field.name])):
                self._fields[name] = field
        self.errors: list[str] = []
        """A sentence for each invalid value."""
        self.typo_warnings: list[str] = []
        """A sentence for each key that is probably misspelt."""
        self.unused: list[Setting] = []
        """The settings that have no effect."""

    def apply(self, settings: Settings) -> Any:
        """Return the defaults with the values of *settings*.

        If several plug-ins set the same parameter, the plug-in that the file lists first wins.
        """
        # Without duplicates: an id that the file lists keeps its rank.
        ranks = {name: rank for rank, name in enumerate(dict.fromkeys(_ids(settings)))}
        chosen: dict[str, tuple[int, object, Setting]] = {}
        for name, setting in settings.items():
            key, rank = _bare(name, ranks)
            field = self._fields.get(key)
            if field is None:
                self._add_unknown(key, setting)
                continue
            value = self._value(field, setting)
            if value is None:
                continue
            if field.name in chosen:
                earlier = chosen[field.name]
                self.unused.append(earlier[2] if rank < earlier[0] else setting)
                if rank >= earlier[0]:
                    continue
            chosen[field.name] = rank, value, setting
        return replace(self._defaults, **{name: value for name, (_, value, _) in chosen.items()})

    def _add_unknown(self, key: str, setting: Setting) -> None:
        last = key.rsplit(".", 1)[-1]
        # The ids of plug-ins and sensors have an effect: their keys are read.
        if last in _LISTS or last.endswith(_LIST_ENDINGS):
            return
        self.unused.append(setting)
        near = get_close_matches(key, self._fields, n=1, cutoff=_TYPO_RATIO)
        if near and last not in _NAV2:
            self.typo_warnings.append(
                f"{self._path}:{setting.line}: {setting.name} has no effect; {suggestion(near[0])}"
            )

    def _value(self, field: Field[Any], setting: Setting) -> object:
        """Return the value of *setting* as the field's type, or None after adding an error."""
        # Older releases of Nav2 have a single plug-in, whose key contains no list.
        is_single = setting.name.endswith("_plugin") and isinstance(setting.value, str)
        value = [setting.value] if is_single else setting.value
        try:
            return convert(value, self._types[field.name])
        except DataError as error:
            self.errors.append(f"{self._path}:{setting.line}: {setting.name} {error.problem}")
            return None


def _ids(settings: Settings) -> Iterator[str]:
    """Yield the ids of a server's plug-ins and sensors: first those that the file lists."""
    for name, setting in settings.items():
        last = name.rsplit(".", 1)[-1]
        if last in _LISTS or last.endswith(_LIST_ENDINGS):
            listed = setting.value if isinstance(setting.value, list) else str(setting.value).split()
            yield from (str(item) for item in listed)
    yield from _PLUGINS


def _bare(name: str, ranks: dict[str, int]) -> tuple[str, int]:
    """Return *name* without the leading ids of plug-ins, and the greatest rank of these ids (-1 for none)."""
    rank = -1
    first, dot, rest = name.partition(".")
    while dot and first in ranks:
        rank = max(rank, ranks[first])
        name = rest
        first, dot, rest = name.partition(".")
    return name, rank
