"""The arguments of the tools of `btcore mcp`, as models: agents see their JSON schemas."""

from typing import Annotated, Any, Final, Literal

from mcp.server.mcpserver.utilities.func_metadata import ArgModelBase
from pydantic import ConfigDict, Field

from btcore_studio.agents.served_folder import MAX_TREE_SIZE

MAX_DURATION: Final = 600.0
"""The maximum duration of a simulated run (s)."""
MAX_EPISODES: Final = 60
"""The maximum number of episodes of a sweep."""

_MAX_LIST: Final = 50
_MAX_DECLARATIONS: Final = 50_000
_WORLD: Final = r"^[a-z][a-z0-9_]{0,40}(:[0-9]{1,9})?$"
_SWEPT: Final = r"^(bb\.[A-Za-z_]\w{0,60}|noise|battery|people|obstacles|rate)$"

Value = str | int | float | bool
_Name = Annotated[str, Field(max_length=500)]
_Names = Annotated[list[_Name], Field(max_length=_MAX_LIST)]
_Models = Annotated[
    _Names, Field(description="TreeNodesModel files in the served folder, which declare leaves without code.")
]
_Given = Annotated[_Names, Field(description="Blackboard keys that the program sets before the first tick.")]
_World = Annotated[
    str,
    Field(
        pattern=_WORLD,
        description="A world: arena, arena_boxes, house, aws_house, lobby, or a random world such as "
        "office:3 or home:7.",
    ),
]
_Duration = Annotated[
    float,
    Field(
        gt=0, le=MAX_DURATION, allow_inf_nan=False, description="Simulated time after which a run ends (s)."
    ),
]
_Log = Annotated[
    str,
    Field(
        max_length=500,
        description="The `log` that `run` returned, such as run-1, or a log file in the served folder: "
        ".btlog, .db3, .btdb, .mcap or .fbl; FILE.db3#2 for session 2.",
    ),
]


def _shorten(schema: dict[str, Any]) -> None:
    """Remove what an agent need not read: titles that repeat names, and the description of the class."""
    for described in (schema, *schema["properties"].values()):
        described.pop("title", None)
    schema.pop("description", None)


class Arguments(ArgModelBase):
    """The arguments of a tool."""

    model_config = ConfigDict(extra="forbid", json_schema_extra=_shorten)


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


class RunArguments(TreeArguments):
    """The arguments of `run`."""

    plans: dict[str, str] = Field(
        {},
        max_length=_MAX_LIST,
        description="Results of leaves from `models`, by name or ID: a letter for each tick, R (RUNNING), S, "
        "F or K (SKIPPED), and | between two starts, such as RRS|F.",
    )
    entries: dict[str, Value] = Field(
        {},
        max_length=_MAX_LIST,
        description="Blackboard entries before the first tick, such as {'goal': '2;1;0'}.",
    )
    duration: _Duration = 60.0
    rate: float = Field(10.0, gt=0, le=1000, allow_inf_nan=False, description="Ticks per second.")
    until: Literal["done", "success", "failure", "never"] = Field(
        "done",
        description="The result that ends the run; after any other result the tree is ticked again.",
    )
    seed: int = Field(0, ge=0, le=2**31)
    world: _World = "arena"
    start: str | None = Field(
        None, max_length=60, description="The robot's start: 'X,Y,YAW' (m, degrees) or 'random'."
    )
    battery: float = Field(100.0, ge=0, le=100, description="Battery level at the start (%).")
    noise: float = Field(1.0, ge=0, le=10, description="Factor of the errors of the sensors.")
    people: int = Field(0, ge=0, le=20)
    obstacles: int = Field(0, ge=0, le=50)
    events: list[Annotated[str, Field(max_length=60)]] = Field(
        [], max_length=20, description="Events: 'box:30' drops a box ahead at 30 s; kidnap:30, carry:30."
    )
    faults: list[Annotated[str, Field(max_length=60)]] = Field(
        [], max_length=20, description="Faults: 'laser:10-20'; laser, odometry, camera or wheel."
    )


class SweepArguments(TreeArguments):
    """The arguments of `sweep`."""

    seeds: int = Field(ge=1, le=MAX_EPISODES, description="The number of seeds, from 0.")
    parameters: dict[
        Annotated[str, Field(pattern=_SWEPT)],
        Annotated[list[Value], Field(min_length=1, max_length=20)],
    ] = Field(
        {},
        max_length=4,
        description="Values to combine: noise, battery, people, obstacles, rate, or bb.KEY for a blackboard "
        "entry.",
    )
    worlds: list[_World] = Field([], max_length=20, description="Worlds to run in.")
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
        max_length=_MAX_DECLARATIONS,
        description="What is known of the leaves, as TOML, instead of the file TREE.proof.toml: given = "
        "['goal']; [leaves.Move] with results, at_once, lasts, endless, uses, hands_over, optional, early, "
        "writes, on_halt; [entries] battery = ['low', 'ok']; [questions].",
    )


class ReadLogArguments(Arguments):
    """The arguments of `read_log`."""

    log: _Log
    changes: int = Field(50, ge=0, le=500, description="How many of the last changes of results to return.")


class ExplainFailureArguments(Arguments):
    """The arguments of `explain_failure`."""

    log: _Log
