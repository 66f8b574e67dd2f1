"""What the extensions of a run bring for its leaves, and in which order.

An extension has `provide`. One that builds upon what another brings (a navigator upon a robot) has a method
``requires(wanted)`` too: the further types that it needs in order to provide its part of *wanted*. It is
asked after those that have none. One whose attribute `stands_in` is True brings what nobody else has brought
(a simulated robot where there is no other): it is asked after its equals.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple


class GatheredResources(NamedTuple):
    """The *resources* for leaves, and the extensions in the order in which they are to be attached.

    *idle* are those that brought nothing.
    """

    resources: list[object]
    extensions: list[Any]
    idle: list[Any]


def gather_resources(
    brought: Sequence[Any], settings: Mapping[str, Any], wanted: Sequence[type]
) -> GatheredResources:
    """Ask every extension of *brought* for what leaves want.

    Who brought something is attached before who brought nothing, and so sees the run from its start to its
    end.
    """
    ordered = sorted(brought, key=lambda one: (hasattr(one, "requires"), getattr(one, "stands_in", False)))
    asked = list(wanted)
    for one in reversed(ordered):
        if hasattr(one, "requires"):
            asked += one.requires(tuple(asked))
    resources: list[object] = []
    givers: list[Any] = []
    others: list[Any] = []
    for one in ordered:
        things = list(one.provide(settings, tuple(asked), tuple(resources)))
        (givers if things else others).append(one)
        resources += things
    return GatheredResources(resources, [*givers, *others], others)


def notify_interrupted(extensions: Sequence[Any]) -> None:
    """Call ``interrupted()`` of those *extensions* that have it: a signal has ended the run."""
    for extension in extensions:
        told = getattr(extension, "interrupted", None)
        if told is not None:
            told()


def merge_reports(reports: Sequence[Mapping[str, object]]) -> dict[str, object]:
    """The *reports* of all extensions as one; objects of the same name are joined, entry by entry."""
    whole: dict[str, object] = {}
    for report in reports:
        for key, value in report.items():
            before = whole.get(key)
            if isinstance(before, dict) and isinstance(value, dict):
                whole[key] = {**before, **value}
            else:
                whole[key] = value
    return whole
