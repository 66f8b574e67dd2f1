"""What extensions bring, and who is asked first."""

from collections.abc import Mapping, Sequence
from typing import Any

from btcore.cli.resources import gather


class Body:
    def __init__(self, maker: str) -> None:
        self.maker = maker


class Brings:
    """Brings a body where nobody else has."""

    def __init__(self, name: str) -> None:
        self.name = name

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object] = ()
    ) -> Sequence[object]:
        return [] if any(isinstance(one, Body) for one in provided) else [Body(self.name)]


class StandsIn(Brings):
    stands_in = True


class Needs(Brings):
    def requires(self, wanted: Sequence[type]) -> Sequence[type]:
        return (Body,)


def test_who_stands_in_is_asked_after_the_others_whatever_their_names() -> None:
    simulated, real = StandsIn("sim"), Brings("zebra")
    found = gather([simulated, real], {}, [Body])
    assert [one.maker for one in found.resources if isinstance(one, Body)] == ["zebra"]
    assert found.brought == [real, simulated]
    assert found.idle == [simulated]


def test_who_builds_upon_others_is_asked_last() -> None:
    builds, simulated = Needs("navigation"), StandsIn("sim")
    found = gather([builds, simulated], {}, [Body])
    assert [one.maker for one in found.resources if isinstance(one, Body)] == ["sim"]
