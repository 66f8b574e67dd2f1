"""The arguments of the tools of `btcore mcp`, as models: agents see their JSON schemas."""

from typing import Annotated, Any, Final, Literal

import click
import msgspec
from mcp.server.mcpserver.utilities.func_metadata import ArgModelBase
from pydantic import ConfigDict, Field, create_model

from btcore.field_options import create_options
from btcore.runs.available_providers import AvailableProviders
from btcore.runs.settings import RunSettings, Settings
from btcore_studio.served_folder import MAX_TREE_SIZE

MAX_EPISODES: Final = 60
"""The maximum number of episodes of a sweep."""

_MAX_LIST: Final = 50
_WORLD: Final[dict[str, Any]] = {
    "pattern": r"^[a-z][a-z0-9_]{0,40}(:[0-9]{1,9})?$",
    "description": "A world: arena, arena_boxes, house, aws_house, lobby, or a random office:N or home:N.",
}
SETTINGS: Final[dict[str, dict[str, Any]]] = {
    "rate": {"le": 1000},
    "seed": {"le": 2**31},
    "world": _WORLD,
    "start": {"max_length": 60},
    "battery": {},
    "noise": {"le": 10},
    "people": {"le": 20},
    "obstacles": {"le": 50},
    "event": {"max_length": 20},
    "fault": {"max_length": 20},
}
"""The settings of providers that agents may use, and what is narrower than in `btcore run`."""
_SWEPT: Final = ("noise", "battery", "people", "obstacles", "rate")

Value = str | int | float | bool
_Name = Annotated[str, Field(max_length=500)]
_Names = Annotated[list[_Name], Field(max_length=_MAX_LIST)]
_Models = Annotated[
    _Names, Field(description="TreeNodesModel files in the served folder, which declare leaves without code.")
]
_Given = Annotated[_Names, Field(description="Blackboard keys that the program sets before the first tick.")]
_Duration = Annotated[float, Field(gt=0, le=600, description="Simulated time after which a run ends (s).")]
_Log = Annotated[
    str,
    Field(
        max_length=500,
        description="The `log` that `run` returned, such as run-1, or a log file in the served folder: "
        ".btrec.txt, .btlog, .db3, .btdb, .mcap or .fbl; FILE.db3#2 for session 2.",
    ),
]


def _shorten(schema: dict[str, Any]) -> None:
    """Remove what an agent need not read: titles that repeat names, and the description of the class."""
    for described in (schema, *schema["properties"].values()):
        described.pop("title", None)
    schema.pop("description", None)


class Arguments(ArgModelBase):
    """The arguments of a tool."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, json_schema_extra=_shorten)


class NodesArguments(Arguments):
    """The arguments of `nodes`."""

    ids: list[_Name] = Field([], max_length=200, description="IDs of nodes.")
    models: _Models = Field([])
    format: Literal[3, 4] = Field(4, description="The XML format.")


class TreeArguments(Arguments):
    """The tree of a call, and the models of its leaves."""

    tree: _Name | None = Field(
        None,
        description="Path of an XML file in the served folder, or the name of a bundled tree such as bumpgo.",
    )
    xml: str | None = Field(
        None,
        max_length=MAX_TREE_SIZE,
        description="The text of the XML file, instead of `tree`. It cannot include other files.",
    )
    tree_id: _Name | None = Field(None, description="ID of a tree in the file; default: its main tree.")
    models: _Models = Field([])
    own_models: bool = Field(
        False,
        description="Whether the TreeNodesModel in the tree's own file declares leaves without code, too. "
        "Without models, leaves that are neither built in nor installed are errors.",
    )


class ValidateArguments(TreeArguments):
    """The arguments of `validate`."""

    given: _Given = Field([])


class ShowArguments(TreeArguments):
    """The arguments of `show`."""

    picture: bool = Field(True, description="Whether to draw a picture.")
    data_flow: bool = Field(
        False, description="Return the nodes that write and read each blackboard entry instead."
    )


def _with_settings(model: type[TreeArguments]) -> type[TreeArguments]:
    """Return *model* with `SETTINGS`; without the simulator, with those of every run."""
    settings_classes: list[type[Settings]] = [RunSettings]
    for simulator in AvailableProviders().of_type("btcore_sim.simulated_robot.SimulatedRobot"):
        settings_classes += simulator.settings_classes
    fields: dict[str, Any] = {}
    for settings_class in settings_classes:
        for field, option in zip(
            msgspec.structs.fields(settings_class), create_options(settings_class), strict=True
        ):
            if field.name not in SETTINGS:
                continue
            limits: dict[str, Any] = {"description": f"{option.metavar}: {option.help}"}
            if isinstance(option.type, click.FloatRange | click.IntRange):
                limits |= {"gt" if option.type.min_open else "ge": option.type.min, "le": option.type.max}
            argument_type = list[Annotated[str, Field(max_length=60)]] if option.multiple else field.type
            fields[field.name] = (argument_type, Field(field.default, **limits | SETTINGS[field.name]))
    return create_model(model.__name__, __base__=model, **fields)


@_with_settings
class RunArguments(TreeArguments):
    """The arguments of `run`, besides `SETTINGS`."""

    outcomes: dict[str, str] = Field(
        {},
        max_length=_MAX_LIST,
        description="Outcomes of leaves from `models`, by name or ID: a letter for each tick, R (RUNNING), "
        "S, F, K (SKIPPED) or X (an exception), and | between two starts, such as RRS|F. S(port=value) "
        "writes an output port.",
    )
    entries: dict[str, Value] = Field(
        {},
        max_length=_MAX_LIST,
        description="Blackboard entries before the first tick, such as {'goal': '2;1;0'}.",
    )
    duration: _Duration = 60.0
    until: Literal["done", "success", "failure", "never"] = Field(
        "done",
        description="The result that ends the run; after any other result the tree is ticked again.",
    )


class SweepArguments(TreeArguments):
    """The arguments of `sweep`."""

    seeds: int = Field(ge=1, le=MAX_EPISODES, description="The number of seeds, from 0.")
    parameters: dict[
        Annotated[str, Field(pattern=rf"^(bb\.[A-Za-z_]\w{{0,60}}|{'|'.join(_SWEPT)})$")],
        Annotated[list[Value], Field(min_length=1, max_length=20)],
    ] = Field(
        {},
        max_length=4,
        description=f"Values to combine: {', '.join(_SWEPT)}, or bb.KEY for a blackboard entry.",
    )
    worlds: list[Annotated[str, Field(**_WORLD)]] = Field([], max_length=20, description="Worlds to run in.")
    duration: _Duration = 60.0
    success_if: _Name | None = Field(
        None,
        description="Condition for a success over the columns of the episodes, such as "
        "\"status == 'SUCCESS' && robot_collisions == 0\"; also time_s, robot_distance_m, robot_battery_min.",
    )


class ProveArguments(TreeArguments):
    """The arguments of `prove`."""

    never: _Names = Field([], description="Propositions that never hold, such as 'Forward & Turn'.")
    ask: _Names = Field(
        [],
        description="Questions: 'never A', 'A leads to B', 'A leads to B within 5 ticks' or 'A before B'.",
    )
    given: _Given = Field([])
    ticks: int | None = Field(None, ge=1, le=100_000, description="Search runs of at most this many ticks.")
    declarations: str | None = Field(
        None,
        max_length=50_000,
        description="What is known of the leaves, as TOML, instead of the file TREE.proof.toml: given = "
        "['goal']; [leaves.Move] with results, at_once, lasts, endless, uses, hands_over, optional, early, "
        "writes, on_halt; [entries] battery = ['low', 'ok']; [questions].",
    )


class LinkArguments(TreeArguments):
    """The arguments of `link`."""

    log: _Log | None = Field(
        None,
        description="The `log` that `run` returned, such as run-1, or a recording (.btrec.txt) in the served "
        "folder: the link then contains this run of the tree.",
    )


class ReadLogArguments(Arguments):
    """The arguments of `read_log`."""

    log: _Log
    changes: int = Field(50, ge=0, le=500, description="How many of the last changes of results to return.")


class ExplainFailureArguments(Arguments):
    """The arguments of `explain_failure`."""

    log: _Log
    node: _Name = Field(
        "",
        description="The path of a node: why did it have its result, why was it halted or not ticked? {KEY}: "
        "who wrote this entry? By default the root: why did the tree fail?",
    )
    at: str | None = Field(None, max_length=30, description="The number of a tick, or seconds such as 12.5s.")
