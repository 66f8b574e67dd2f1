"""Statuses have distinguishable colours for people with any kind of colour vision."""

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from btcore_monitor.events import TransitionEvent
from btcore_monitor.screen.style import COLOUR_BLIND, GROOT, PALETTES, Palette
from btcore_monitor.viewer_options import PALETTE_NAMES as NAMES

RUNNING, SUCCESS, FAILURE, SKIPPED = range(1, 5)
# Machado, Oliveira and Fernandes 2009: full deficiency, in linear RGB.
VISION = {
    "normal": np.eye(3),
    "protan": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deutan": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.01182, 0.04294, 0.968881],
    ],
    "tritan": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.3039],
    ],
}
DISTINGUISHABLE = 20.0
"""ΔE in CIE Lab: ten times the just noticeable difference."""


def linear(colour: int) -> np.ndarray:
    rgb = np.array([int(colour) >> shift & 255 for shift in (24, 16, 8)]) / 255
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    """CIE 1976 L*a*b* of linear sRGB, white D65."""
    matrix = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    xyz = matrix @ rgb.clip(0, 1) / np.array([0.9505, 1.0, 1.089])
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def distance(first: int, second: int, vision: str) -> float:
    seen = [lab(np.array(VISION[vision]) @ linear(colour)) for colour in (first, second)]
    return float(np.linalg.norm(seen[0] - seen[1]))


@pytest.mark.parametrize("vision", VISION)
@pytest.mark.parametrize("paint", ["fill", "rim", "ink"])
def test_statuses_of_the_colour_blind_palette_differ_for_every_vision(vision: str, paint: str) -> None:
    colours = getattr(COLOUR_BLIND, paint)[:5]
    near = {
        pair: distance(colours[pair[0]], colours[pair[1]], vision)
        for pair in itertools.combinations(range(5), 2)
    }
    assert min(near.values()) > DISTINGUISHABLE, near


def test_the_colour_blind_palette_separates_results_better_than_groots() -> None:
    apart = [
        distance(palette.fill[SUCCESS], palette.fill[FAILURE], "deutan") for palette in (GROOT, COLOUR_BLIND)
    ]
    assert apart[1] > 2 * apart[0]


@pytest.mark.parametrize("palette", PALETTES.values(), ids=PALETTES)
def test_names_are_readable_on_every_pill(palette: Palette) -> None:
    """At least 2:1 by WCAG's contrast, for letters that are drawn bold."""
    white = float(linear(palette.text) @ [0.2126, 0.7152, 0.0722])
    for colour in [*palette.fill, palette.busy]:
        dark = float(linear(colour) @ [0.2126, 0.7152, 0.0722])
        assert (white + 0.05) / (dark + 0.05) > 2.0, hex(colour)


def test_the_command_line_lists_all_palettes() -> None:
    assert tuple(PALETTES) == NAMES


def test_the_tree_and_the_log_use_the_palette(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    events = run(70)
    recording = recorded(events, tmp_path / "run.rrd", palette=COLOUR_BLIND)
    pills = recording.at("/tree/pills", "LineStrips2D:colors", 4_500_000_000)
    assert pills[5] == COLOUR_BLIND.fill[RUNNING]
    colours = {values[0] for _, values in recording.of("/log", "TextLog:color")}
    statuses = {event.status for event in events if isinstance(event, TransitionEvent)}
    assert {int(COLOUR_BLIND.ink[status]) for status in statuses} <= colours
