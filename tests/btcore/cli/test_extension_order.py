"""What extensions bring, and who is asked first."""

from collections.abc import Mapping, Sequence
from typing import Any

from btcore.cli.extension import gather_resources


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


def test_stand_in_extensions_provide_after_the_others() -> None:
    simulated, real = StandsIn("sim"), Brings("zebra")
    found = gather_resources([simulated, real], {}, [Body])
    assert [one.maker for one in found.resources if isinstance(one, Body)] == ["zebra"]
    assert found.extensions == [real, simulated]
    assert found.idle == [simulated]


def test_dependent_extensions_provide_last() -> None:
    builds, simulated = Needs("navigation"), StandsIn("sim")
    found = gather_resources([builds, simulated], {}, [Body])
    assert [one.maker for one in found.resources if isinstance(one, Body)] == ["sim"]
