"""Extracted and inlined branches of recorded trees, which tick as before."""

import gzip
import json
import os
import random
from pathlib import Path
from typing import Any

import pytest

from btcore.registry.registry import Registry
from btcore.xml.edit.editor import EditError, apply_edits
from btcore.xml.plan.plan import Plans, plan_document
from btcore.xml.plan.tree_plan import NodePlan
from btcore.xml.read.read import parse_text
from btcore_studio.edit.subtrees import extract_subtree, inline_subtree
from tests.conformance.recorded_cases import conformance_registry, run_case

DATA = Path(__file__).parents[3] / "conformance/data"
COUNT = int(os.environ.get("BTCORE_EDITS", "500")) // 4
NODES = conformance_registry()
MAIN = '<root BTCPP_format="4">\n  <BehaviorTree ID="A">\n    {}\n  </BehaviorTree>\n</root>\n'


def recorded(name: str) -> list[dict[str, Any]]:
    with gzip.open(DATA / f"{name}.jsonl.gz", "rt", encoding="utf-8") as lines:
        cases = [json.loads(line) for line in lines]
    return [case for case in cases if "ticks" in case["expect"] and "tree" not in case]


def plans_of(text: str, nodes: Registry = NODES) -> Plans:
    return plan_document(parse_text(text), nodes, every_tree=True)


def nodes_of(plans: Plans) -> list[NodePlan]:
    return [node for tree in plans.trees.values() for node in tree.node_plans()]


def behaviour(case: dict[str, Any], xml: str) -> list[Any]:
    """The calls of the leaves, the statuses and the main tree's entries in each tick."""
    ticks = run_case({**case, "xml": xml}, NODES)["ticks"]
    return [(tick.get("calls"), tick.get("status"), tick.get("bb")) for tick in ticks]


@pytest.mark.parametrize("name", ["v4_full", "v4_scopes"])
def test_an_extracted_branch_ticks_as_before(name: str) -> None:
    rng, done = random.Random(f"extract:{name}"), 0
    cases = recorded(name)
    for case in rng.sample(cases, min(len(cases), COUNT)):
        plans = plans_of(case["xml"])
        node = rng.choice(nodes_of(plans))
        try:
            edits = extract_subtree(plans, node.element, "Extracted")
        except EditError:
            continue
        text = apply_edits(case["xml"], edits)
        assert behaviour(case, text) == behaviour(case, case["xml"]), f"{case['id']}: {text}"
        done += 1
    assert done > min(len(cases), COUNT) / 4


def test_an_inlined_tree_ticks_as_before() -> None:
    rng, done = random.Random("inline"), 0
    cases = [
        case for name in ("v4_scopes", "v4_full") for case in recorded(name) if "<SubTree" in case["xml"]
    ]
    for case in rng.sample(cases, min(len(cases), 2 * COUNT)):
        plans = plans_of(case["xml"])
        calls = [node for node in nodes_of(plans) if node.subtree_call is not None]
        try:
            edit = inline_subtree(plans, rng.choice(calls).element)
        except (EditError, IndexError):
            continue
        text = apply_edits(case["xml"], [edit])
        before, after = behaviour(case, case["xml"]), behaviour(case, text)
        # Entries of the called tree are entries of the calling tree now.
        known = [entries.keys() if entries is not None else () for _, _, entries in before]
        after = [
            (calls, status, entries and {key: entries[key] for key in entries if key in keys})
            for (calls, status, entries), keys in zip(after, known, strict=True)
        ]
        assert after == before, f"{case['id']}: {text}"
        done += 1
    assert done > 20


def test_the_text_of_an_extracted_branch_and_back() -> None:
    branch = '<Sequence> <!-- ä -->\n      <Script code="x := 1;\n  y = @z"/>\n    </Sequence>'
    text = MAIN.format(branch)
    plans = plans_of(text)
    extracted = apply_edits(text, extract_subtree(plans, nodes_of(plans)[0].element, "B"))
    assert extracted == (
        '<root BTCPP_format="4" main_tree_to_execute="A">\n  <BehaviorTree ID="A">\n'
        '    <SubTree ID="B" x="{x}" y="{y}"/>\n  </BehaviorTree>\n'
        f'  <BehaviorTree ID="B">\n    {branch}\n  </BehaviorTree>\n</root>\n'
    )
    plans = plans_of(extracted)
    call = next(node for node in nodes_of(plans) if node.subtree_call is not None)
    assert apply_edits(extracted, [inline_subtree(plans, call.element)]) == extracted.replace(
        '<SubTree ID="B" x="{x}" y="{y}"/>', branch
    )


@pytest.mark.parametrize(
    ("inner", "call", "reason"),
    [
        ("<AlwaysSuccess/>", 'k="1"', "to a constant"),
        ('<AlwaysSuccess _skipIf="a"/>', '_skipIf="b"', "have conditions"),
        ('<Script code="{k}"/>', "", "any key"),
        ('<Script code="k := 1"/>', 'k="{a b}"', "not a name in scripts"),
    ],
)
def test_what_cannot_be_inlined(inner: str, call: str, reason: str) -> None:
    second = f'<BehaviorTree ID="B">{inner}</BehaviorTree></root>'
    plans = plans_of(MAIN.format(f'<SubTree ID="B" {call}/>').replace("</root>", second))
    with pytest.raises(EditError, match=reason):
        inline_subtree(plans, nodes_of(plans)[0].element)


@pytest.mark.parametrize(
    ("branch", "id", "reason"),
    [
        ("<AlwaysSuccess/>", "A", "already"),
        ('<Script code="{k}"/>', "B", "any key"),
        ('<Sleep msec="{a b}"/>', "B", "cannot be an attribute"),
    ],
)
def test_what_cannot_be_extracted(branch: str, id: str, reason: str) -> None:
    plans = plans_of(MAIN.format(branch))
    with pytest.raises(EditError, match=reason):
        extract_subtree(plans, nodes_of(plans)[0].element, id)
