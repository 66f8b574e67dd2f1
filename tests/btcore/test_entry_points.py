"""The entry points of installed distributions, and what those of btcore's own providers say."""

import json
import sys
from pathlib import Path

import pytest

from btcore import entry_points
from btcore.clock import Clock
from btcore.registry.resources import full_name
from btcore.runs.providers import Provider

POINTS = {
    point.name: point
    for point in entry_points.find(entry_points.PROVIDERS_GROUP)
    if point.distribution == entry_points.OWN_DISTRIBUTION
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


def install(information: Path, name: str, points: str, header: str = "METADATA") -> None:
    """Create the metadata of the distribution *name* in the folder *information*."""
    information.mkdir(parents=True)
    text = f"[btcore.logs]\nlog = log\n\n[btcore.nodes]\n# nodes\n{points}\n[btcore.nodes.others]\nx = x\n"
    (information / "entry_points.txt").write_text(text)
    (information / header).write_text(f"Metadata-Version: 2.1\nName: {name}\n\nName: description\n")


def test_first_distribution_of_a_name_on_the_path_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    install(first / "Old_Arm.parts-2.0.dist-info", "Old-Arm.parts", "arm = arm.nodes")
    install(second / "old_arm_parts-1.0.dist-info", "old_arm_parts", "hidden = arm.nodes")
    (first / "leg-2.0.dist-info").mkdir()
    install(second / "leg-1.0.dist-info", "leg", "hidden = leg")
    points = "hand=json:decoder.JSONDecoder [extra]\nfist = json"
    install(second / "hand.egg-info", "hand", points, "PKG-INFO")
    path = [str(first), str(second), str(tmp_path / "missing")]
    monkeypatch.setattr(sys, "path", [*path, *sys.path])
    found = entry_points.find(entry_points.NODES_GROUP)
    added = {point.name: point for point in found if point.distribution != entry_points.OWN_DISTRIBUTION}
    assert {name: point.distribution for name, point in added.items()} == {
        "arm": "Old-Arm.parts",
        "fist": "hand",
        "hand": "hand",
    }
    assert added["hand"].load() is json.JSONDecoder
    assert added["fist"].load() is json
