"""The time of an editor's requests, compared with lxml validating the same file against btcore's XSD.

    python benchmarks/editing.py [--pairs 9] [--lines 2000 10000] [--quick] [--json]

An editor requests diagnostics after each change, so both programs begin with the text: lxml parses it and
validates it against the schema that `btcore schema` writes; btcore parses it and finds the errors and
warnings of `btcore validate`. Completion and hover also begin with the text, which the editor has just
changed; the cursor is on a remapped key in the middle of the document. The schema and the registry are
created before, and further rounds find the scripts of the first round parsed. The documents are projects of
small trees with scripts, conditions, loops and remapped keys, which the main tree calls; one tree in ten
reads an entry that is never written. A pair consists of one request of each kind, directly after each other.
Times are processor times.
"""

from collections.abc import Sequence
from functools import partial
from importlib import import_module
from importlib.util import find_spec

from lxml import etree

from btcore import Registry
from btcore.clock import NS_PER_MS
from btcore.diagnostics import Diagnostic
from btcore.extras import describe_missing
from btcore.lint.validate import validate_document
from btcore.xml.read.read import parse_text
from btcore_studio.schema import write_schema
from measure.paired_timing import Spread, Work, measure_rounds
from measure.report import Report, at_most, create_parser

editor = import_module("measure.editor_requests") if find_spec("pygls") else None

LINES = (2_000, 10_000)
SMALL = 1_680
"""The lines of a document of 1,000 nodes."""
BUDGET_MS = 100
"""The maximum time of the diagnostics of that document and of a hover, which needs the index of all keys."""
WITHIN = at_most(pure=1, compiled=1)
GROWTH = at_most(pure=1.5, compiled=1.5)
"""The target of the time per line of the longest document, relative to the shortest document."""
TREE = """\
  <BehaviorTree ID="Visit{0}">
    <Sequence name="visit {0}">
      <Script code=" attempts := 0; place := 'room {0}' "/>
      <Fallback name="go or give up {0}">
        <RetryUntilSuccessful num_attempts="3">
          <Sequence name="attempt {0}">
            <Script code=" attempts += 1 "/>
            <ScriptCondition code=" attempts &lt; limit " _skipIf=" speed == 0.0 "/>
            <Delay delay_msec="{0}">
              <SetBlackboard value="{{place}}" output_key="goal"/>
            </Delay>
          </Sequence>
        </RetryUntilSuccessful>
        <ForceFailure>
          <Sleep name="wait {0}" msec="{{{1}}}"/>
        </ForceFailure>
      </Fallback>
    </Sequence>
  </BehaviorTree>"""
CALL = '    <SubTree ID="Visit{0}" name="visit {0}" limit="{{limit}}" speed="0.{0}" goal="{{goal_{0}}}"/>'


def document(lines: int) -> str:
    """Return a document of about *lines* lines."""
    trees = range(lines // (TREE.count("\n") + 2))
    return "\n".join(
        [
            '<root BTCPP_format="4" main_tree_to_execute="Main">',
            *(TREE.format(number, "pause" if number % 10 == 0 else "limit") for number in trees),
            '  <BehaviorTree ID="Main">',
            '    <Sequence name="all visits">',
            '    <Script code=" limit := 3 "/>',
            *map(CALL.format, trees),
            "    </Sequence>",
            "  </BehaviorTree>",
            "</root>",
        ]
    )


def diagnose(text: str, nodes: Registry) -> list[Diagnostic]:
    """Return the diagnostics of a document."""
    return validate_document(parse_text(text), nodes=nodes)


def validate_by_schema(data: bytes, schema: etree.XMLSchema) -> bool:
    """Return whether a document is valid by *schema*."""
    return schema.validate(etree.fromstring(data))


def check_found(text: str, nodes: Registry, schema: etree.XMLSchema) -> None:
    """Raise AssertionError if one of the programs does not find what it should find."""
    assert validate_by_schema(text.encode(), schema), schema.error_log
    assert not validate_by_schema(text.encode().replace(b"<Sleep ", b"<Sleap "), schema)
    assert {item.code for item in diagnose(text, nodes)} == {"W201"}


def compare(report: Report, sizes: Sequence[int]) -> None:
    """Add the rows."""
    nodes = Registry.standard()
    schema = etree.XMLSchema(etree.fromstring(write_schema(nodes).encode()))
    texts = {lines: document(lines) for lines in (SMALL, *sizes)}
    check_found(texts[sizes[0]], nodes, schema)
    works: dict[str, Work] = {}
    for lines, text in texts.items():
        works[f"schema {lines}"] = partial(validate_by_schema, text.encode(), schema)
        works[f"diagnostics {lines}"] = partial(diagnose, text, nodes)
        if editor is not None:
            middle = text.index(CALL.format(text.count("<SubTree ") // 2))
            requests = editor.requests_at(text, text.index("{limit}", middle) + 1, "limit")
            works |= {f"{name} {lines}": work for name, work in requests.items()}
    measured = measure_rounds([works] * (report.pairs + 1))
    for name in ("diagnostics", "completion", "hover") if editor is not None else ("diagnostics",):
        for lines in sizes:
            ours, peer = f"{name} {lines}", f"schema {lines}"
            figures = {
                "btcore": f"{measured.time(ours).median / NS_PER_MS:.0f} ms",
                "lxml": f"{measured.time(peer).median / NS_PER_MS:.1f} ms",
            }
            report.add(f"{name}, {lines:,} lines / lxml's schema", measured.ratio(ours, peer), None, figures)
    both = [f"{name} {SMALL}" for name in ("diagnostics", "hover") if f"{name} {SMALL}" in works]
    total = [sum(times) / NS_PER_MS for times in zip(*(measured.rounds[name] for name in both), strict=True)]
    spread = Spread.of(total)
    figures = {"btcore": f"{spread.median:.0f} ms"}
    report.add(
        f"diagnostics and index of 1,000 nodes / {BUDGET_MS} ms", spread.times(1 / BUDGET_MS), WITHIN, figures
    )
    first, last = sizes[0], sizes[-1]
    if first != last:
        growth = measured.ratio(f"diagnostics {last}", f"diagnostics {first}").times(first / last)
        report.add(f"diagnostics of a line, in {last:,} lines / in {first:,} lines", growth, GROWTH)


def main() -> None:
    """Run the benchmark."""
    parser = create_parser(__doc__ or "")
    parser.add_argument("--lines", type=int, nargs="+", default=LINES)
    options = parser.parse_args()
    report = Report("editing", "The requests of an editor, compared with lxml's validation", options.pairs)
    if editor is None:
        report.remarks.append(describe_missing("pygls"))
    compare(report, (200,) if options.quick else options.lines)
    report.output(options.json)


if __name__ == "__main__":
    main()
