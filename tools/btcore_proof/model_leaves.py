"""Leaves that take every result and write every value that their model allows, as a search decides.

Their choices are made by `Choices`, which repeats a given list of choices and takes the first option
of every choice beyond it.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from types import MappingProxyType
from typing import Any, ClassVar, Final, NamedTuple, NoReturn

from btcore import NodeSpec
from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.blackboard.ports import Binding, Direction, Input, Output, Port, PortRole, braced_key
from btcore.engine.control import DecoratorNode
from btcore.engine.journal import Journal
from btcore.engine.leaf import Condition, StatefulAction, SyncAction
from btcore.engine.node import TreeNode
from btcore.nodes.manual_selector import Prompt
from btcore.registry.registry import Registry
from btcore.status import FAILURE, IDLE, RUNNING, SUCCESS, NodeType, Status
from btcore.tree.tree import Tree
from btcore.values import STRING, ValueType, number_of
from btcore.values.types import IntegerType, RealType
from btcore_proof.entry_names import names_of_entry
from btcore_proof.interrupts import (
    EndlessTickError,
    SearchInterrupt,
    UnknownOutcomeError,
    UnknownValueError,
)
from btcore_proof.leaf_models import LeafModel, ModelError, domain_of, model_of, resources_of

MAX_CHOICES: Final = 300
"""The number of choices within a tick after which the tick counts as endless."""


class UnknownValue:
    """The value of an entry that a leaf has written, if no domain is declared. Any use of it raises.

    Args:
        key: The key of the entry.
        operands: The values with which it can be compared: `numbers`, `texts` or, if this is not known, "".
        choices: Decides comparisons.
    """

    __slots__ = ("_choices", "key", "operands")

    def __init__(self, key: str, operands: str, choices: "Choices") -> None:
        self.key = key
        self.operands = operands
        self._choices = choices

    def _raise(self, *_: object) -> NoReturn:
        choices = self._choices
        raise choices.interrupt(UnknownValueError(self.key, self, choices.decide))

    def __getattr__(self, name: str) -> NoReturn:
        self._raise()

    @property  # type: ignore[misc]
    def __class__(self) -> NoReturn:  # type: ignore[override]
        # isinstance() with another class reads this attribute.
        self._raise()

    def __eq__(self, other: object) -> bool:
        # Also with itself: an entry that was written again holds the same object, but perhaps another value.
        self._raise()

    # Conversion errors show the value, so that those of compiled code end here, too.
    __hash__ = __repr__ = __str__ = __format__ = __reduce_ex__ = __bytes__ = __fspath__ = _raise
    __bool__ = __int__ = __float__ = __complex__ = __index__ = __lt__ = __le__ = __gt__ = __ge__ = _raise
    __iter__ = __next__ = __reversed__ = __len__ = __length_hint__ = _raise
    __contains__ = __getitem__ = __setitem__ = __delitem__ = __call__ = __enter__ = __exit__ = _raise
    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _raise
    __floordiv__ = __rfloordiv__ = __mod__ = __rmod__ = __divmod__ = __rdivmod__ = __pow__ = __rpow__ = _raise
    __and__ = __rand__ = __or__ = __ror__ = __xor__ = __rxor__ = __lshift__ = __rlshift__ = _raise
    __rshift__ = __rrshift__ = __matmul__ = __rmatmul__ = __neg__ = __pos__ = __abs__ = __invert__ = _raise
    __round__ = __trunc__ = __floor__ = __ceil__ = _raise


class RecordableUnknownValue(UnknownValue):
    """An unknown value that has a text, with which it is recorded."""

    __slots__ = ()

    def __repr__(self) -> str:  # type: ignore[override]
        return "?"


_EXACT: Final = 2**53
"""Scripts compare no greater integers."""


def operands_of(value_type: ValueType) -> str:
    """Return the values with which scripts can compare every value of a type, as in UnknownValue."""
    if isinstance(value_type, IntegerType):
        return "numbers" if value_type.low >= -_EXACT and value_type.high <= _EXACT else ""
    return "numbers" if isinstance(value_type, RealType) else "texts" if value_type is STRING else ""


def _operand_text(value: object) -> str:
    """Return the text that stands for an operand of a comparison."""
    if isinstance(value, UnknownValue):
        return f"{{{value.key}}}"
    return f"{value:g}" if isinstance(value, float) else repr(value)


def _operands(value: object) -> str:
    """Return the values with which scripts can compare *value*, as in UnknownValue."""
    if isinstance(value, UnknownValue):
        return value.operands
    if isinstance(value, str):
        return "texts"
    return "" if number_of(value) is None else "numbers"


ModelOutcome = tuple[Status, tuple[int, ...]]
"""A result of a leaf, and for each output the number of the value; () = nothing is written."""
_NOT_WRITTEN: Final = -1
"""Stands for the number of a value in an outcome in which an output is not written."""


class LeafEvent(NamedTuple):
    """One tick of a leaf: its status before, its result, and the values that it wrote, by port.

    If the leaf was halted while RUNNING, the result is IDLE. A model decorator has an event with the result
    RUNNING if it holds its child back, else with SUCCESS.
    """

    leaf: TreeNode
    before: Status
    result: Status
    written: Mapping[str, object]


class Choices:
    """The choices within one tick of a tree.

    Attributes:
        given: The choices to repeat: for each the number of the option.
        made: The choices of this tick: the number of the option, and the number of options.
        events: The ticks and halts of model leaves, in order.
        domains: The declared values of entries, as texts, by key.
        unread: The keys of entries that leaves need not write, because nothing reads them.
        counted: The scope and the key of each entry whose writes a node counts.
        watcher: Called before each choice with the leaf (None for a node of another type), the number of its
            options, and the option that it will take.
        raised: The first interrupt with which the search ends this tick; None = the tick goes on.
        guess: The comparison with an unknown value that is being decided; "" = none.
        guesses: The comparisons with unknown values in this tick, as sentences.
        assumed: The keys of unknown values that were compared although this may be impossible.
        unknown_class: The class of unknown values.
    """

    def __init__(self, domains: Mapping[str, tuple[str, ...]] | None = None) -> None:
        self.given: Sequence[int] = ()
        self.made: list[tuple[int, int]] = []
        self.events: list[LeafEvent] = []
        self.domains = dict(domains or {})
        self.unread: frozenset[str] = frozenset()
        self.counted: Sequence[tuple[Blackboard, str]] = ()
        self.watcher: Callable[[TreeNode | None, int, int], None] | None = None
        self.raised: SearchInterrupt | None = None
        self.guess = ""
        self.guesses: list[str] = []
        self.assumed: set[str] = set()
        self.unknown_class: type[UnknownValue] = UnknownValue
        self._unknown: dict[tuple[str, str], UnknownValue] = {}

    def begin(self, given: Sequence[int]) -> None:
        """Begin a tick that repeats the choices *given*."""
        self.given = given
        self.raised = None
        self.made.clear()
        self.events.clear()
        self.guesses.clear()

    def choose(self, options: int, leaf: TreeNode | None = None) -> int:
        """Return the number of the chosen option, from 0 to *options* - 1.

        Args:
            options: The number of options.
            leaf: The leaf that chooses; None for a node of another type.
        """
        if self.raised is not None:
            # A node has caught it.
            raise self.raised
        count = len(self.made)
        if count >= MAX_CHOICES:
            place = "" if leaf is None else f"'{leaf.config.path}': "
            text = f"{place}the tick does not end: it repeats nodes without a pause"
            raise self.interrupt(EndlessTickError(text))
        chosen = self.given[count] if count < len(self.given) else 0
        if self.watcher is not None:
            self.watcher(leaf, options, chosen)
        self.made.append((chosen, options))
        return chosen

    def choose_outcome(
        self, leaf: TreeNode, options: Sequence[ModelOutcome], writers: Sequence["Writer"]
    ) -> int:
        """Return the number of the chosen outcome of a leaf.

        Args:
            options: Its possible outcomes.
            writers: The outputs that an outcome writes.
        """
        return self.choose(len(options), leaf) if len(options) > 1 else 0

    def interrupt(self, error: SearchInterrupt) -> SearchInterrupt:
        """Note that the search ends this tick with *error*, and return it."""
        self.raised = self.raised or error
        return error

    def decide(self, error: UnknownValueError, operator: str, left: object, right: object) -> bool:
        """Choose whether a comparison with an unknown value is true.

        Args:
            error: The interrupt that the comparison has raised.
            operator: The sign of the comparison.
            left: The value before the sign.
            right: The value after the sign.
        """
        if self.raised is error:
            self.raised = None
        self.guess = f"{_operand_text(left)} {operator} {_operand_text(right)}"
        try:
            is_true = self.choose(2) == 0
        finally:
            sentence, self.guess = self.guess, ""
        self.guesses.append(f"{sentence} is {'true' if is_true else 'false'}")
        if not _operands(left) or _operands(left) != _operands(right):
            unknown = [value for value in (left, right) if isinstance(value, UnknownValue)]
            untyped = [value for value in unknown if not value.operands]
            self.assumed |= {value.key for value in untyped or unknown}
        return is_true

    def unknown(self, key: str, operands: str = "") -> UnknownValue:
        """Return the unknown value of the entry *key*; for *operands*, see UnknownValue."""
        known = self._unknown.get((key, operands))
        if known is None:
            known = self._unknown[key, operands] = self.unknown_class(key, operands, self)
        return known


class Writer(NamedTuple):
    """An output port of a leaf, and the values that the leaf may write to it."""

    output: Output
    key: str
    values: tuple[object, ...]


_NOTHING: Final[Mapping[str, object]] = MappingProxyType({})


class _Chooser:
    """Chooses the results and the outputs of one leaf or decorator."""

    def __init__(self, leaf: TreeNode, model: LeafModel, choices: Choices) -> None:
        self._leaf = leaf
        self._model = model
        self.choices = choices
        self._reads: list[Input] | None = None
        self._optional: list[Input] = []
        self._writers: list[Writer] = []
        self._all_writers: list[Writer] = []
        self._halt_writers: list[Writer] = []
        self._start: list[ModelOutcome] = []
        self._options: dict[tuple[tuple[bool, ...], bool, bool], list[ModelOutcome]] = {}
        self._starts_running = model.lasts and not model.at_once

    def take(self, before: Status) -> Status:
        """Read the mandatory inputs, choose a result and what is written, and record the tick."""
        if self._reads is None:
            self._reads = self._prepare()
        for port in self._reads:
            assert port.key is not None
            entry = port.blackboard.find(port.key)
            if entry is None or not isinstance(entry.value, UnknownValue):
                port.read()
        choices = self.choices
        writers = self._writers
        if self._starts_running and before is not RUNNING:
            options = self._start
        else:
            fresh = tuple([self._is_fresh(writer) for writer in writers]) if writers else ()
            has_inputs = not self._optional or not any(_is_unwritten(port) for port in self._optional)
            is_repeated = self._model.early and not any(_is_unwritten(writer.output) for writer in writers)
            key = (fresh, has_inputs, is_repeated)
            outcomes = self._options.get(key)
            options = self._options[key] = self._outcomes(*key) if outcomes is None else outcomes
        status, picked = options[choices.choose_outcome(self._leaf, options, self._all_writers)]
        written: Mapping[str, object] = _NOTHING
        if picked:
            written = {
                writer.output.name: self._write(writer, pick)
                for writer, pick in zip(self._all_writers, picked, strict=True)
                if pick >= 0
            }
        choices.events.append(LeafEvent(self._leaf, before, status, written))
        return status

    def halt(self) -> None:
        """Record the halt, and write what the model writes then."""
        if self._reads is None:
            self._reads = self._prepare()
        written: Mapping[str, object] = _NOTHING
        if self._halt_writers:
            every = list(product(*[range(len(writer.values) or 1) for writer in self._halt_writers]))
            picks = every[self.choices.choose(len(every), self._leaf) if every[1:] else 0]
            written = {
                writer.output.name: self._write(writer, pick)
                for writer, pick in zip(self._halt_writers, picks, strict=True)
            }
        self.choices.events.append(LeafEvent(self._leaf, RUNNING, IDLE, written))

    def _prepare(self) -> list[Input]:
        """Find the outputs and the optional inputs. Return the mandatory inputs."""
        config = self._leaf.config
        self._optional = [
            port
            for port in config.inputs.values()
            if port.name in self._model.optional and port.key is not None
        ]
        model = self._model
        free: list[Writer] = []
        for output in (*config.outputs.values(), *_entries_of(self._leaf, model)):
            if output.key is not None and output.key not in self.choices.unread:
                names = names_of_entry(output.blackboard, output.key)
                values = domain_of(output.binding.port, self.choices.domains, names)
                writer = Writer(output, output.key, values)
                (free if output.name in model.writes else self._writers).append(writer)
                if output.name in model.on_halt:
                    self._halt_writers.append(writer)
        self._all_writers = [*self._writers, *free]
        self._start = self._with_free_writes([(RUNNING, ())])
        return [port for port in config.inputs.values() if _is_mandatory(port, self._model)]

    def _is_fresh(self, writer: Writer) -> bool:
        """Return whether a node may notice a write: not if the entry already holds the unknown value.

        A node that counts the writes of the entry notices every write.
        """
        if writer.values:
            return True
        entry = writer.output.blackboard.find(writer.key)
        if entry is None or not isinstance(entry.value, UnknownValue):
            return True
        return any(board.find(key) is entry for board, key in self.choices.counted)

    def _all_options(self, fresh: tuple[bool, ...], has_inputs: bool) -> list[ModelOutcome]:
        """Return the results with the numbers of the values that are written.

        With SUCCESS the leaf writes all its outputs, with FAILURE all or none, with RUNNING none or,
        if the model writes early, all. Without all optional inputs it does not succeed, unless it can only
        succeed.
        """
        without_success = [status for status in self._model.results if status is not SUCCESS]
        results = self._model.results if has_inputs or not without_success else without_success
        picks: list[tuple[int, ...]] = [()]
        for writer in self._writers:
            picks = [(*pick, number) for pick in picks for number in range(len(writer.values) or 1)]
        options: list[ModelOutcome] = []
        for status in results:
            if status is not SUCCESS:
                options.append((status, ()))
            if status is SUCCESS or (status is FAILURE and any(fresh)):
                options += [(status, pick) for pick in picks]
        if self._model.lasts:
            options.append((RUNNING, ()))
            if self._model.early and any(fresh):
                options += [(RUNNING, pick) for pick in picks]
        return options

    def _outcomes(self, fresh: tuple[bool, ...], has_inputs: bool, is_repeated: bool) -> list[ModelOutcome]:
        """Return all outcomes. *is_repeated*: the leaf may have written its outputs in an earlier tick."""
        options = self._all_options(fresh, has_inputs)
        if is_repeated and self._writers and any(status is SUCCESS for status, _ in options):
            options.append((SUCCESS, ()))
        return self._with_free_writes(options)

    def _with_free_writes(self, options: list[ModelOutcome]) -> list[ModelOutcome]:
        """Return the options, each with and without the writes that do not depend on the result."""
        count = len(self._writers)
        free = self._all_writers[count:]
        if not free:
            return options
        every = list(product(*[range(_NOT_WRITTEN, len(writer.values) or 1) for writer in free]))
        return [
            (status, (*(picked or (_NOT_WRITTEN,) * count), *more))
            for status, picked in options
            for more in every
        ]

    def _write(self, writer: Writer, pick: int) -> object:
        if writer.values:
            value = writer.values[pick]
            writer.output.write(value)
            return value
        board = writer.output.blackboard
        port_type = writer.output.type
        entry: Entry = board.find(writer.key) or board.declare(writer.key, port_type)
        if port_type.strong and entry.declared.strong and not port_type.same(entry.declared):
            names = f"a value of the type {port_type.name} to {{{writer.key}}}, which is of the type"
            text = f"'{self._leaf.config.path}' writes {names} {entry.declared.name}: declare its domain"
            raise self.choices.interrupt(UnknownOutcomeError(text))
        unknown = self.choices.unknown(writer.key, operands_of(port_type))
        entry.put(unknown, board.now())
        if isinstance(board.recorder, Journal):
            board.recorder.add_written(board, writer.key, {"__text": "?"}, entry.declared)
        return unknown


def _entries_of(leaf: TreeNode, model: LeafModel) -> list[Output]:
    """Return outputs for the entries that the model writes without a port."""
    board = leaf._blackboard
    return [Output(Binding(Port(key, Direction.OUT), f"{{{key}}}"), board) for key in sorted(model.entries)]


def _is_unwritten(port: Input | Output) -> bool:
    entry = port.blackboard.find(port.key or "")
    return entry is None or entry.value is None


def _is_mandatory(port: Input, model: LeafModel) -> bool:
    """Return whether a leaf with this model raises if the entry of the input *port* is not written."""
    declared = port.port
    return (
        port.key is not None
        and declared.default is None
        and not declared.optional
        and port.name not in model.optional
    )


def counted_entries(tree: Tree) -> list[tuple[Blackboard, str]]:
    """Return the scope and the key of each entry whose writes a node counts, such as SkipUnlessUpdated."""
    return [
        (node._blackboard, braced_key(port.text) or port.text)
        for node in tree.nodes
        for port in node.config.inputs.values()
        if port.port.role is PortRole.WATCHED_ENTRY
    ]


def unread_keys(tree: Tree, choices: Choices, watched: str = "") -> frozenset[str]:
    """Return the keys that only model leaves write, and that no node reads.

    A model leaf reads its mandatory inputs, and those that its model declares as optional. A key counts as
    read if its name occurs in any input or attribute of another node, in a script or in *watched*, the text
    of the questions.
    """
    written: set[str] = set()
    texts = [watched]
    for node in tree.nodes:
        config = node.config
        model = model_leaf_model(node)
        inputs = [
            port
            for port in config.inputs.values()
            if model is None or port.name in model.optional or _is_mandatory(port, model)
        ]
        texts += [port.key if port.key is not None else str(port.literal) for port in inputs]
        texts += config.conditions.values()
        if model is None:
            for name, text in config.attributes.items():
                texts += [name, text]
        else:
            written.update(output.key for output in config.outputs.values() if output.key is not None)
            written.update(output.key or "" for output in _entries_of(node, model))
    read = set(_WORD.findall(" ".join(texts)))
    return frozenset(
        key for key in written if key not in choices.domains and read.isdisjoint(_WORD.findall(key))
    )


_WORD: Final = re.compile(r"\w+")


class ModelDecorator(DecoratorNode):
    """A decorator that ticks its child, or not, as the search decides.

    It writes its outputs when it ticks the child. If its model *lasts*, it may be RUNNING instead, but not
    forever, and not while the child is RUNNING. It may return a result of its model; it then halts the child.
    """

    model: ClassVar[LeafModel]

    def __init__(self, choices: Choices) -> None:
        free = self.model._replace(results=(SUCCESS,), at_once=True)
        self._choices = choices
        self._free = _Chooser(self, free, choices)
        self._passing = _Chooser(self, free._replace(lasts=False), choices)

    def tick(self) -> Status:
        """Tick the child, unless the search decides otherwise."""
        before = self._status
        self.set_status(RUNNING)
        results = self.model.results
        if results:
            option = self._choices.choose(1 + len(results), self)
            if option:
                self.reset_child()
                return results[option - 1]
        chooser = self._passing if self.child._status is RUNNING else self._free
        return RUNNING if chooser.take(before) is RUNNING else self.child.execute_tick()


class _ModelLeaf:
    """A leaf that follows its model."""

    model: ClassVar[LeafModel]

    def __init__(self: Any, choices: Choices) -> None:
        self._chooser = _Chooser(self, self.model, choices)

    def follow_model(self: Any) -> Any:
        """Return a result that the model allows."""
        return self._chooser.take(self._status)


class ModelAction(_ModelLeaf, StatefulAction):
    """An action that follows its model; it may last several ticks."""

    on_start = on_running = _ModelLeaf.follow_model

    def on_halted(self) -> None:
        """Record the halt."""
        self._chooser.halt()


class ModelSyncAction(_ModelLeaf, SyncAction):
    """An action of one tick that follows its model."""

    tick = _ModelLeaf.follow_model


class ModelCondition(_ModelLeaf, Condition):
    """A condition that follows its model."""

    tick = _ModelLeaf.follow_model


class ModelPrompt(Prompt):
    """A user who may give every answer, for `ManualSelector`."""

    def __init__(self, choices: Choices) -> None:
        self._choices = choices

    def choose(self, question: str, options: list[str]) -> int:
        """Return the number of the chosen option."""
        return self._choices.choose(len(options))


def with_model_leaves(nodes: Registry, declared: Mapping[str, Mapping[str, object]]) -> Registry:
    """Return a copy of a registry in which leaves that follow their models replace all leaves with code.

    Models also replace decorators that need resources or are declared. Leaves that are built in remain.

    Args:
        declared: The declarations beside the tree, by the ID of the leaf.

    Raises:
        ModelError: A declaration is invalid.
    """
    copy = nodes.copy()
    for format in (3, 4):
        for id, manifest in nodes.manifests_of(format).items():
            is_leaf = manifest.type in (NodeType.ACTION, NodeType.CONDITION)
            is_decorator = manifest.type is NodeType.DECORATOR and (
                bool(resources_of(manifest)) or id in declared
            )
            if not (is_leaf or is_decorator) or manifest.library == "btcore" or id in copy.substitutions:
                continue
            model = model_of(manifest, declared.get(id))
            if is_decorator and model.uses:
                raise ModelError(f"<{id}>: a decorator uses no resources; declare those of its child")
            ports = list(manifest.ports.values())
            if copy.get(id, format) is manifest:
                copy.remove(id)
                model_class = _model_class(id, manifest.cls, model, ports)
                copy.add(model_class, ID=id)
    return copy


def _model_class(id: str, cls: type[TreeNode], model: LeafModel, ports: Iterable[Port]) -> type[TreeNode]:
    base: type[TreeNode]
    if issubclass(cls, DecoratorNode):
        base = ModelDecorator
    elif cls.spec.node_type is NodeType.CONDITION:
        base = ModelCondition
    else:
        base = ModelAction if model.lasts or not issubclass(cls, SyncAction) else ModelSyncAction
    listed = list(ports)
    members = {
        "model": model,
        "spec": NodeSpec(state_fields=()),
        "provided_ports": staticmethod(lambda: listed),
        "__doc__": "A model.",
    }
    return type(id, (base,), members)


def model_leaf_model(node: TreeNode) -> LeafModel | None:
    """Return the model that *node* follows, or None if it has its own code."""
    return node.model if isinstance(node, _MODELS) else None


_MODELS: Final = (ModelAction, ModelSyncAction, ModelCondition, ModelDecorator)
