"""The entry points of btcore's own providers say what the providers declare."""

import pytest

from btcore import entry_points
from btcore.clock import Clock
from btcore.runs.providers import Provider, full_name

POINTS = {
    point.name: point
    for point in entry_points.find(entry_points.PROVIDERS_GROUP)
    if entry_points.distribution_of(point) == entry_points.OWN_DISTRIBUTION
}


@pytest.mark.parametrize("value", sorted({point.value for point in POINTS.values()}))
def test_entry_points_name_the_provider_and_its_types(value: str) -> None:
    points = [point for point in POINTS.values() if point.value == value]
    provider = points[0].load()
    assert isinstance(provider, Provider)
    assert {point.name.partition("-")[0] for point in points} == {provider.name}
    named = {point.name.partition("-")[2] for point in points} - {""}
    types = {full_name(kind) for kind in provider.types}
    # A clock never causes its provider to be used; only a provider of a clock alone is searched by this type.
    assert named - {full_name(Clock)} <= types
    assert types == named | ({full_name(Clock)} if provider.provides_clock else set())
