"""Pictures of trees as PNG."""

import re
from functools import partial
from io import BytesIO

import pytest

from btcore import Registry
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_text
from btcore_drawing.diagram import diagram_of_document
from btcore_drawing.svg import MAX_SIDE, PictureError, diagram_to_svg, svg_to_png

resvg_py = pytest.importorskip("resvg_py", reason="the extra mcp is not installed")
Image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")

BLUE, GREEN = (0x2F, 0x66, 0xC8), (0x3D, 0x8B, 0x3D)


def svg_of(body: str) -> str:
    document = parse_text(f'<root BTCPP_format="4"><BehaviorTree ID="Tür">{body}</BehaviorTree></root>')
    plans = plan_document(document, Registry.standard())
    return diagram_to_svg(diagram_of_document(plans), "Tür")


def test_picture_shows_cards_glyphs_edges_and_texts() -> None:
    svg = svg_of('<Sequence><Sleep msec="100"/><SetBlackboard value="1" output_key="{k}"/></Sequence>')
    picture = Image.open(BytesIO(svg_to_png(svg))).convert("RGB")
    sides = [int(side) for side in re.findall(r'(?:width|height)="(\d+)"', svg)[:2]]
    assert picture.size == pytest.approx([1.5 * side for side in sides], abs=1)
    found = {colour: count for count, colour in picture.getcolors(1_000_000)}
    assert found[BLUE] > 300  # the badge of the Sequence
    assert found[GREEN] > 400  # the badges of the actions
    assert found[(255, 255, 255)] > 5000  # the cards
    # Thin strokes have no pure colour: the key is the only text in a shade of amber.
    assert any(red > 160 and green < 130 and blue < 80 for red, green, blue in found)
    dark = sum(count for (red, green, blue), count in found.items() if max(red, green, blue) < 80)
    assert dark > 200  # the names


def test_large_drawing_becomes_a_smaller_picture_while_its_texts_can_be_read() -> None:
    wide = "<Fallback>" + "<AlwaysFailure/>" * 9 + "</Fallback>"
    picture = Image.open(BytesIO(svg_to_png(svg_of(f"<Sequence>{wide * 6}</Sequence>"))))
    assert max(picture.size) == MAX_SIDE
    with pytest.raises(PictureError, match="draw a subtree, or an SVG"):
        svg_to_png(svg_of(f"<Sequence>{wide * 40}</Sequence>"))


def test_machine_without_fonts_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resvg_py, "svg_to_bytes", partial(resvg_py.svg_to_bytes, skip_system_fonts=True))
    with pytest.raises(PictureError, match="needs a font such as DejaVu Sans"):
        svg_to_png(svg_of("<AlwaysSuccess/>"))
