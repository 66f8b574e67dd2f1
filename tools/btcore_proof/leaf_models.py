"""Models of leaves for proofs: what a leaf may return, write and use.

A model comes from the `spec` of the leaf's class, the metadata of its TreeNodesModel, and a declaration
beside the tree, each more specific than the one before.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final, NamedTuple

from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.ports import Port
from btcore.clock import Clock
from btcore.engine.leaf import Condition, SyncAction
from btcore.errors import BtcoreError, ConversionError
from btcore.names import names_in
from btcore.registry.manifest import Manifest
from btcore.registry.mock_leaves import MockCondition
from btcore.registry.resources import is_tree_resource
from btcore.status import ANY_RESULT, FAILURE, RUNNING, SKIPPED, SUCCESS, NodeType, Status
from btcore.suggestions import did_you_mean, join_names
from btcore.values import BOOL, EnumType

RESULTS: Final = {"SUCCESS": SUCCESS, "FAILURE": FAILURE, "SKIPPED": SKIPPED}
_NAMES: Final = ("uses", "optional", "writes", "on_halt")
_KEYS: Final = ("results", "lasts", "at_once", "endless", "early", "hands_over", *_NAMES)


class ModelError(BtcoreError):
    """A declaration for a proof is invalid."""


class LeafModel(NamedTuple):
    """What a leaf may do in a tick.

    Attributes:
        results: The results with which the leaf may complete, in the order in which they are tried.
        lasts: Whether the leaf may be RUNNING.
        at_once: Whether the leaf may complete in the tick that starts it.
        endless: Whether the leaf may be RUNNING forever. Any other leaf completes after some ticks.
        uses: The names of the resources that only one leaf at a time may use, such as a robot.
        optional: The names of the input ports whose entries need not be written before the leaf reads them;
            without them it does not succeed.
        early: Whether the leaf may write its outputs already while it is RUNNING.
        writes: The names of outputs, or keys of other entries, that the leaf may write in any tick, whatever
            its result is. The rules of all other outputs do not hold for them.
        entries: Those of *writes* that are no outputs.
        on_halt: The names of the outputs that the leaf writes when it is halted.
        hands_over: Whether another action may take over the resources in the tick in which the leaf is
            halted, before its halt, because the halt does not affect them.
    """

    results: tuple[Status, ...]
    lasts: bool
    at_once: bool
    endless: bool
    uses: frozenset[str]
    optional: frozenset[str] = frozenset()
    early: bool = False
    writes: frozenset[str] = frozenset()
    entries: frozenset[str] = frozenset()
    on_halt: frozenset[str] = frozenset()
    hands_over: bool = False


def model_of(manifest: Manifest, declared: Mapping[str, Any] | None = None) -> LeafModel:
    """Return the model of a leaf.

    By default a condition and an action of one tick return SUCCESS or FAILURE, and any other action also
    RUNNING. If the leaf's spec declares `results` or `may_complete_on_start`, they restrict the results.
    An action uses the resources that it declares as parameters. The results of a decorator are those that it
    returns without its child.

    Args:
        manifest: The registration of the leaf.
        declared: The declaration of the leaf beside the tree, with the names of the attributes of LeafModel.

    Raises:
        ModelError: The metadata of the leaf or *declared* is invalid.
    """
    spec = manifest.spec
    is_decorator = manifest.type is NodeType.DECORATOR
    if is_decorator:
        results, lasts = spec.results_without_child, RUNNING in spec.results_without_child
    else:
        results = spec.results - {SKIPPED} if spec.results is ANY_RESULT else spec.results
        lasts = not issubclass(manifest.cls, (Condition, SyncAction, MockCondition))
    uses = spec.uses
    if uses is None:
        uses = resources_of(manifest) if manifest.type is NodeType.ACTION else frozenset()
    model = LeafModel(
        results=_order(results),
        lasts=lasts,
        at_once=not lasts or spec.may_complete_on_start is not False,
        endless=lasts and not is_decorator and (spec.is_endless or not results),
        uses=uses,
        optional=frozenset(spec.optional_inputs),
        early=spec.writes_early,
        writes=frozenset(spec.writes or ()),
        on_halt=frozenset(spec.writes_on_halt),
        hands_over=spec.hands_over,
    )
    metadata = {key: text for key, text in manifest.metadata.items() if key in _KEYS}
    places = {f"the metadata of <{manifest.id}>": metadata, f"[leaves.{manifest.id}]": declared or {}}
    for place, values in places.items():
        model = _narrow(model, values, place)
        if is_decorator and "results" in values:
            model = model._replace(lasts="RUNNING" in str(values["results"]), endless=False)
    return model._replace(entries=model.writes - set(manifest.ports))


def domain_of(
    port: Port, declared: Mapping[str, tuple[str, ...]], names: Sequence[str]
) -> tuple[object, ...]:
    """Return the values that a leaf may write to an entry; () = the values are not known.

    Args:
        port: The output port.
        declared: The texts of the declared values of each entry.
        names: The names of the entry, in the tree of the leaf and in the calling trees.

    Raises:
        ModelError: A declared value is not of the type of the port.
    """
    port_type = port.type
    key = next((name for name in names if name in declared), "")
    texts = declared.get(key)
    if texts is None:
        if port_type is BOOL:
            return (True, False)
        return tuple(port_type.members) if isinstance(port_type, EnumType) else ()
    try:
        return tuple(port_type.from_text(text) if port_type.strong else text for text in texts)
    except ConversionError as error:
        raise ModelError(f"[entries] {key}: {error}") from error


def _order(results: Collection[Status]) -> tuple[Status, ...]:
    return tuple(status for status in RESULTS.values() if status in results)


def resources_of(manifest: Manifest) -> frozenset[str]:
    """Return the names of the types of the resources that a leaf gets."""
    types = [parameter.resource_type for parameter in manifest.resource_parameters]
    return frozenset(
        resource_type.__name__
        for resource_type in types
        if isinstance(resource_type, type)
        and not is_tree_resource(resource_type)
        and resource_type not in (Clock, Blackboard)
    )


def _narrow(model: LeafModel, declared: Mapping[str, Any], place: str) -> LeafModel:
    """Return *model* with the values that a declaration replaces."""
    for key, value in declared.items():
        if key not in _KEYS:
            raise ModelError(f"{place}: unknown key '{key}'{did_you_mean(key, _KEYS)}")
        if key == "results":
            names = _names(value, place, key)
            unknown = [name for name in names if name not in RESULTS and name != "RUNNING"]
            if unknown:
                raise ModelError(
                    f"{place}: '{unknown[0]}' is not a result: use {join_names([*RESULTS, 'RUNNING'])}"
                )
            results = _order([RESULTS[name] for name in names if name in RESULTS])
            lasts = model.lasts if results else True
            model = model._replace(results=results, lasts=lasts or "RUNNING" in names, endless=not results)
        elif key in _NAMES:
            named: Any = {key: frozenset(_names(value, place, key))}
            model = model._replace(**named)
        else:
            flag = {"true": True, "false": False}.get(str(value).lower())
            if flag is None:
                raise ModelError(f"{place}: {key} is true or false, not {value!r}")
            changed: Any = {key: flag}
            model = model._replace(**changed)
    if model.endless and not model.lasts:
        model = model._replace(lasts=True)
    return model


def _names(value: object, place: str, key: str) -> list[str]:
    """Return a list of names, which may be given as a text with commas."""
    if isinstance(value, str):
        return names_in(value)
    if isinstance(value, list) and all(isinstance(name, str) for name in value):
        return value
    raise ModelError(f"{place}: {key} is a list of names, not {value!r}")
