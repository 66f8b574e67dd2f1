"""A tree as an SVG: it is complete, nothing overlaps, and a browser needs no other file."""

import re
from itertools import combinations

import pytest
from lxml import etree

from btcore import Registry
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_text
from btcore_drawing.diagram import diagram_of_document
from btcore_drawing.svg import diagram_to_svg

SVG = "{http://www.w3.org/2000/svg}"
TEXT = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence name="the &lt;whole&gt; round" _skipIf="late">
      <SubTree ID="Greet" name="hello" who="{guest}"/>
      <Parallel success_count="1"><AlwaysSuccess/><Sleep msec="200"/></Parallel>
      <Script code="a := 1"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Greet"><Inverter><AlwaysFailure/></Inverter></BehaviorTree>
</root>"""


def svg(text: str) -> str:
    plans = plan_document(parse_text(text), Registry.standard())
    plans.diagnostics.raise_errors()
    return diagram_to_svg(diagram_of_document(plans), "Main")


@pytest.fixture
def drawing() -> etree._Element:
    return etree.fromstring(svg(TEXT).encode())


def words(drawing: etree._Element) -> list[str]:
    return ["".join(str(part) for part in element.itertext()) for element in drawing.iter(f"{SVG}text")]


def test_names_ids_numbers_ports_and_scripts_are_written(drawing: etree._Element) -> None:
    assert {"Main", "the <whole> round", "Sequence", "hello", "SubTree Greet", "1", "8"} <= set(
        words(drawing)
    )
    joined = "\n".join(words(drawing))
    for port in ("who{guest}", "success_count1", "msec200", "codea := 1", "_skipIflate"):
        assert port in joined


def test_default_value_is_not_drawn(drawing: etree._Element) -> None:
    assert "failure_count" not in "\n".join(words(drawing))


def test_svg_references_no_other_resource() -> None:
    assert not re.search(r"href|url\(|@import|<script|<image", svg(TEXT))


def test_frame_of_a_subtree_encloses_only_its_content(drawing: etree._Element) -> None:
    frames = [element for element in drawing.iter(f"{SVG}rect") if element.get("class") == "frame"]
    assert len(frames) == 1
    inside = [name for name, box in cards(drawing).items() if within(box, rectangle(frames[0]))]
    assert sorted(inside) == ["AlwaysFailure", "Inverter"]


def test_wide_tree_is_wrapped() -> None:
    many = "".join(f'<AlwaysSuccess name="the step with the number {number}"/>' for number in range(30))
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>{many}</Sequence></BehaviorTree></root>'
    assert float(etree.fromstring(svg(text).encode()).get("width") or 0) < 1000


def test_long_text_is_cut_in_the_card_and_complete_in_the_tooltip() -> None:
    code = "a := " + " + ".join(["1"] * 60)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="A"><Script code="{code}"/></BehaviorTree></root>'
    drawing = etree.fromstring(svg(text).encode())
    assert not any(code in word for word in words(drawing))
    assert any(code in str(element.text) for element in drawing.iter(f"{SVG}title"))


Rectangle = tuple[float, float, float, float]


def rectangle(element: etree._Element, x: float = 0, y: float = 0) -> Rectangle:
    left, top = float(element.get("x", "0")) + x, float(element.get("y", "0")) + y
    return left, top, left + float(element.get("width", "0")), top + float(element.get("height", "0"))


def within(inner: Rectangle, outer: Rectangle) -> bool:
    return all(inside >= outside for inside, outside in zip(inner[:2], outer[:2], strict=True)) and all(
        inside <= outside for inside, outside in zip(inner[2:], outer[2:], strict=True)
    )


def apart(first: Rectangle, second: Rectangle) -> bool:
    return first[2] <= second[0] or second[2] <= first[0] or first[3] <= second[1] or second[3] <= first[1]


def cards(drawing: etree._Element) -> dict[str, Rectangle]:
    found = {}
    for card in drawing.iter(f"{SVG}rect"):
        group = card.getparent()
        if str(card.get("class")).startswith("card") and group is not None:
            x, y = map(float, re.findall(r"[-\d.]+", str(group.get("transform"))))
            name = next(
                str(element.text) for element in group.iter(f"{SVG}text") if element.get("class") == "name"
            )
            found[name] = rectangle(card, x, y)
    return found


def test_cards_do_not_overlap(drawing: etree._Element) -> None:
    placed = cards(drawing)
    assert len(placed) == 8
    assert all(apart(first, second) for first, second in combinations(placed.values(), 2))
