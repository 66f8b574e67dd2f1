"""The data of the requests `btcore/…`, by which a page draws and edits trees; protocol.ts is the page's side.

They are requests of the language server beside those of the Language Server Protocol, and have its positions:
lines and UTF-16 code units, both from 0.
"""

from typing import Annotated, Any, Literal

import msgspec

NodeKind = Literal["action", "condition", "control", "decorator", "subtree", "undefined"]
PortDirection = Literal["in", "out", "inout"]


class Data(msgspec.Struct, frozen=True, rename="camel"):
    """An object of a message. Unknown members are ignored, as in the Language Server Protocol."""


class Position(Data, frozen=True):
    """A place in a text."""

    line: int
    character: int


class Range(Data, frozen=True):
    """A part of a text."""

    start: Position
    end: Position


class TextEdit(Data, frozen=True):
    """A part of a text is replaced."""

    range: Range
    new_text: str


class WorkspaceEdit(Data, frozen=True):
    """The edits of several documents, by URI."""

    changes: dict[str, list[TextEdit]]


class DocumentIdentifier(Data, frozen=True):
    """The URI of a document."""

    uri: str


class DocumentParams(Data, frozen=True):
    """The parameters of a request about a document."""

    text_document: DocumentIdentifier


class Place(Data, frozen=True):
    """An element of a document: *position* is where its start tag begins."""

    uri: str
    position: Position


# --- btcore/drawing


class DrawingParams(DocumentParams, frozen=True):
    """What to draw.

    Attributes:
        tree: The ID of the tree; None for the main tree, or the first.
        folded: The keys of the nodes whose children are hidden.
        since: The number of a drawing that the client has: its nodes that have only moved are not sent again.
            0 for none.
        styled: Whether the SVG is the whole drawing, with its style sheet and the descriptions of the nodes,
            so that it can be saved.
        call: The key of the running SubTree node whose tree this is; "" for a main tree.
    """

    tree: str | None = None
    folded: frozenset[str] = frozenset()
    since: int = 0
    styled: bool = False
    call: str = ""


class DrawnNode(Data, frozen=True):
    """A node of a drawing.

    Attributes:
        key: Identifies the node in drawings of later texts, too.
        parent: 1 + the index of the parent; 0 for the root.
        calls: The ID of the called tree, or "".
        place: The element, which may be in an included document.
        end: The end of the element.
        hidden: The number of hidden nodes below, if the node is folded.
        children: The minimum and the maximum number of children; None is no limit.
        x: The place of the card.
        card: The SVG of the card without its number; "" below a folded node.
        edge: The path from the parent, relative to the upper left corner of the card; "" for the root.
    """

    key: str
    parent: int
    id: str
    name: str
    kind: NodeKind
    calls: str
    ports: list[tuple[str, str]]
    place: Place
    end: Position
    hidden: int
    leaf: bool
    disabled: bool
    children: tuple[int, int | None]
    x: float = 0
    y: float = 0
    width: float = 0
    height: float = 0
    card: str = ""
    edge: str = ""


MovedNode = tuple[int, int, int, int, int, int, int, float, float, str | None]
"""A node of an earlier drawing: its index, its index there, and its present parent, line, character, line and
character of the end, x, y and edge; None for the same edge."""


class TreeSummary(Data, frozen=True):
    """A tree of a document or of its includes, and the IDs of the trees that call it."""

    id: str
    place: Place
    callers: list[str]
    is_main: bool


class Drawing(Data, frozen=True):
    """A drawing of a tree.

    Attributes:
        tree: The ID of the tree, or "" if there is no tree.
        number: Identifies the drawing; see `DrawingParams.since`.
        moved: The nodes that are not in *nodes*, because the client has them.
        svg: The drawing without cards and edges, which are in *nodes*; with `styled` the whole drawing. "" if
            there are no nodes.
        left: Where the coordinates of the cards begin in the SVG.
        about: The description of each node type in *nodes*, by its ID.
        broken: Why the text is not XML, or "". The drawing then shows what can be read.
    """

    tree: str
    format: int
    svg: str
    nodes: list[DrawnNode]
    about: dict[str, str]
    trees: list[TreeSummary]
    broken: str
    number: int = 0
    moved: list[MovedNode] = []
    left: float = 0
    top: float = 0
    width: float = 0
    height: float = 0


# --- btcore/palette


class PalettePort(Data, frozen=True):
    """A port of a node type; *default* is "" if there is none."""

    name: str
    direction: PortDirection
    type: str
    default: str
    about: str


class PaletteItem(Data, frozen=True):
    """A node type, or a tree that can be called.

    Attributes:
        group: The library, model file or document from which the node is known; "BehaviorTree.CPP" for
            built-in nodes.
        symbol: The SVG path of the symbol in the node's badge, around (0, 0) within a radius of 9 units.
        is_editable: Whether the document has the model, or could have it: the node has no code, and no other
            model. The *ports* are then as the model writes them.
    """

    id: str
    kind: NodeKind
    group: str
    about: str
    symbol: str
    ports: list[PalettePort]
    is_editable: bool = False


class Palette(Data, frozen=True):
    """What can be added to a tree of a document."""

    items: list[PaletteItem]


# --- btcore/node


class Field(Data, frozen=True):
    """An attribute of a node.

    Attributes:
        text: The text of the attribute; None if it is not written.
        choices: Keys in braces, members of enums, or IDs of trees.
        is_script: Whether the text is a script.
    """

    name: str
    group: Literal["name", "port", "condition", "subtree", "other"]
    text: str | None
    direction: PortDirection | Literal[""] = ""
    type: str = ""
    default: str | None = None
    is_required: bool = False
    about: str = ""
    choices: list[str] = []
    is_script: bool = False


class NodeForm(Data, frozen=True):
    """All attributes of a node, and the IDs of node *types* that may replace its type."""

    id: str
    name: str
    kind: NodeKind
    about: str
    fields: list[Field]
    types: list[str]


# --- btcore/edit


def _snake_case(name: str) -> str:
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name).lstrip("_")


class Command(Data, frozen=True, tag_field="kind", tag=_snake_case):
    """An operation on nodes, trees or models."""


class Add(Command, frozen=True):
    """Add a node, or the call of a tree, after *index* children of *parent*."""

    parent: Place
    index: int
    id: str


class Paste(Command, frozen=True):
    """Add elements after *index* children of *parent*, with the models and trees that *xml* also contains."""

    parent: Place
    index: int
    xml: str


class Move(Command, frozen=True):
    """Move nodes, which are adjacent afterwards; *index* counts the children before they are moved."""

    nodes: list[Place]
    parent: Place
    index: int


class Remove(Command, frozen=True):
    """Remove nodes with their children."""

    nodes: list[Place]


class Duplicate(Command, frozen=True):
    """Insert a copy of each node after it."""

    nodes: list[Place]


class Wrap(Command, frozen=True):
    """Put adjacent siblings into a new node."""

    nodes: list[Place]
    id: str


class Unwrap(Command, frozen=True):
    """Put the children of a node in its place."""

    node: Place


class ChangeType(Command, frozen=True):
    """Make a node a node of another type; attributes that are no ports of the type are removed."""

    node: Place
    id: str


class SetAttribute(Command, frozen=True, tag="set"):
    """Give an attribute a text; None removes it."""

    node: Place
    name: str
    text: str | None


class Disable(Command, frozen=True):
    """Let nodes be skipped."""

    nodes: list[Place]


class Enable(Command, frozen=True):
    """Undo `Disable`."""

    nodes: list[Place]


class Extract(Command, frozen=True):
    """Make a branch a tree of its own."""

    node: Place
    id: str


class Inline(Command, frozen=True):
    """Put the nodes of a called tree in the place of the call."""

    node: Place


class AddTree(Command, frozen=True):
    """Add a tree without nodes."""

    uri: str
    id: str


class RemoveTree(Command, frozen=True):
    """Remove a tree that no other tree calls."""

    uri: str
    id: str


class SetMainTree(Command, frozen=True):
    """Write the ID of the main tree."""

    uri: str
    id: str


class SetModel(Command, frozen=True):
    """Write the model of a node type, or of a tree, or replace it.

    Attributes:
        before: The present ID of a node type that gets another ID in all files, or "".
        renamed: The new name of each port that gets another name in all files.
    """

    uri: str
    id: str
    type: Literal["Action", "Condition", "Control", "Decorator", "SubTree"]
    ports: list[PalettePort]
    before: str = ""
    renamed: dict[str, str] = {}


class RemoveModel(Command, frozen=True):
    """Remove the model of a node type that no tree uses."""

    uri: str
    id: str


AnyCommand = (
    Add
    | Paste
    | Move
    | Remove
    | Duplicate
    | Wrap
    | Unwrap
    | ChangeType
    | SetAttribute
    | Disable
    | Enable
    | Extract
    | Inline
    | AddTree
    | RemoveTree
    | SetMainTree
    | SetModel
    | RemoveModel
)


class EditParams(Data, frozen=True):
    """The operation to compute.

    Attributes:
        drawing: What to draw after the edit, so that the client need not request it.
    """

    command: AnyCommand
    drawing: DrawingParams | None = None


class EditResult(Data, frozen=True):
    """The edit of an operation.

    Attributes:
        select: The elements to select, in the text after the edit.
        notes: What a pasted text lacks, and new warnings; with a drawing, `btcore/warnings` returns them.
        drawing: The drawing after the edit; None if it was not requested, or if the edit changes no document
            or others than the drawn document.
    """

    edit: WorkspaceEdit
    select: list[Place]
    notes: list[str]
    drawing: Drawing | None = None


# --- btcore/warnings


class NewWarnings(Data, frozen=True):
    """The warnings that the last edit with a drawing has added."""

    messages: list[str]


# --- btcore/preview


class ProblemData(Data, frozen=True):
    """See `Diagnostic.attributes` and `Diagnostic.characters`."""

    attributes: tuple[str, ...]
    characters: tuple[int, int]


class Problem(Data, frozen=True):
    """A diagnostic of the protocol without its place: *severity* is 1 for an error, and 2 for a warning."""

    severity: Literal[1, 2]
    message: str
    data: ProblemData


class Preview(Data, frozen=True):
    """The problems that an operation would add, errors first."""

    problems: list[Problem]


# --- btcore/leaf


class LeafParams(DocumentParams, frozen=True):
    """The ID of a node without code."""

    id: str


class Leaf(Data, frozen=True):
    """The Python code of a node, and its test, with the names of their files in the same folder."""

    name: str
    text: str
    test_name: str
    test: str


# --- btcore/copy


class CopyParams(Data, frozen=True):
    """The elements to copy."""

    nodes: list[Place]


class CopyResult(Data, frozen=True):
    """The elements, with the models and trees that they need."""

    xml: str


# --- btcore/watch and what follows it; the parameters of btcore/live are made in live.py


class WatchParams(Data, frozen=True):
    """The *address* of a running tree; "" ends the connection."""

    address: str


class BreakpointsParams(Data, frozen=True):
    """The *keys* of the nodes before which the running tree stops."""

    keys: list[str]


class ReleaseParams(Data, frozen=True):
    """The *status* that the node at the breakpoint returns without being ticked; "" = it is ticked."""

    status: Literal["", "SUCCESS", "FAILURE"] = ""


class NewEntryParams(Data, frozen=True):
    """The *value* of an entry, as in an attribute of a port; *path* is that of the subtree, or ""."""

    path: Annotated[str, msgspec.Meta(max_length=4_000)]
    key: Annotated[str, msgspec.Meta(max_length=1_000)]
    value: Annotated[str, msgspec.Meta(max_length=10_000)]


# --- btcore/run, and the requests of the run that it starts


class LeafPlan(Data, frozen=True):
    """How a mock leaf of a run answers; by default the user is asked.

    Attributes:
        outcomes: Outcomes such as `RRS|F`, which it follows; "" for none.
        chance: The probability with which it succeeds; None if it follows no chance.
        seed: Determines the results that *chance* draws.
    """

    outcomes: str = ""
    chance: float | None = None
    seed: int = 0


class RunParams(DocumentParams, frozen=True):
    """The tree to run.

    Attributes:
        tree: The ID of the tree; None for the main tree.
        period: The simulated time between two ticks (s).
        plans: How leaves answer, by the keys of the nodes.
        again: The number of a run whose answers are given again, for as many ticks; 0 for none.
    """

    tree: str | None = None
    period: float = 0.1
    plans: dict[str, LeafPlan] = {}
    again: int = 0


class RunRequest(Data, frozen=True):
    """The parameters of a request about a run, which *run* identifies."""

    run: int


class StepParams(RunRequest, frozen=True):
    """Where to go: to the end of *ticks* ticks, or into, over or out of the present node in a tick.

    Attributes:
        breakpoints: The keys of nodes at whose begin the run stops.
    """

    to: Literal["tick", "into", "over", "out"]
    ticks: int = 1
    breakpoints: frozenset[str] = frozenset()


class AnswerParams(RunRequest, frozen=True):
    """What the leaf of the question does: a letter of outcomes, and the texts of output ports."""

    result: Literal["S", "F", "R", "K", "X"]
    outputs: dict[str, str] = {}


class RunMomentParams(RunRequest, frozen=True):
    """The moment after *position* steps, and after *event* begins and ends of nodes in the next step.

    Attributes:
        cut: Whether the run forgets what follows the step before this moment.
    """

    position: int
    event: int = 0
    cut: bool = False


class RunLeafParams(RunRequest, frozen=True):
    """How the leaf with a key answers from now on."""

    key: str
    plan: LeafPlan


class RunFilesParams(RunRequest, frozen=True):
    """The files to return: the recording alone, or with a test of the tree in the file *tree*."""

    test: bool = False
    tree: str = ""


class RunFile(Data, frozen=True):
    """A file, which is not written yet."""

    name: str
    text: str


class RunFiles(Data, frozen=True):
    """The recording of a run, and a test that runs it again."""

    files: list[RunFile]


class QuestionPort(Data, frozen=True):
    """An output port of the leaf of a question, with the type and the key of the entry."""

    name: str
    type: str
    key: str


class RunQuestion(Data, frozen=True):
    """A leaf that is ticked and has no answer; *can_run* is whether RUNNING is one."""

    key: str
    path: str
    inputs: dict[str, str]
    outputs: list[QuestionPort]
    can_run: bool


class RunState(Data, frozen=True):
    """The present moment of a run.

    Attributes:
        run: Identifies the run.
        count: The number of steps.
        colours: The status of the root over time: a digit for every *width* steps.
        moment: The moment, as in the result of `btcore/moment`.
        event: The number of begins and ends of nodes in the step; 0 between two steps.
        stopped: The key of the node that has begun or ended last in the step, or "".
        problem: Why the tick cannot be run further, or "".
        keys: Only when the run begins: the keys of the nodes, in the order of the statuses.
        calls: Only then: the calls of trees.
        leaves: Only then: how each mock leaf answers, by key.
    """

    run: int
    count: int
    colours: str
    width: int
    moment: dict[str, Any]
    event: int
    stopped: str
    question: RunQuestion | None
    problem: str
    keys: list[str] | None = None
    calls: list[dict[str, Any]] | None = None
    leaves: dict[str, LeafPlan] | None = None


# --- btcore/recording, whose moments btcore/moment returns


class RecordingParams(Data, frozen=True):
    """The text of a recording (`.btrec.txt`) to show. The result is as `recording` of `btcore/start`."""

    text: str


# --- btcore/startRealRun; the parameters of btcore/realRun are in real_runs.py


class RealRunParams(DocumentParams, frozen=True):
    """The tree to run with its real leaves, and a line of *options* of `btcore run`."""

    tree: str | None = None
    options: str = ""


# --- btcore/why, of a run or of a recording


class WhyParams(Data, frozen=True):
    """The node to explain: what it did in the last of *position* steps; *run* is 0 for a recording."""

    key: str
    position: int
    run: int = 0


class WhyLink(Data, frozen=True):
    """A link of a chain: a node in a *tick* (the key "" is outside of the tree); *tried* may be ""."""

    key: str
    tick: int
    because: str
    tried: str


class Why(Data, frozen=True):
    """Why a node did what it did: the chain from its result to what this depends on."""

    question: str
    answer: str
    links: list[WhyLink]
