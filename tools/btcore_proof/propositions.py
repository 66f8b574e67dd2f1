"""The language of questions: propositions about one tick, and how they must follow each other."""

import operator
import re
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from btcore.engine.node import TreeNode
from btcore.errors import BtcoreError
from btcore.status import RUNNING, Status
from btcore.tree.tree import Tree
from btcore_proof.interrupts import UnknownValueError
from btcore_proof.tick_runner import Tick

Proposition = Callable[[Tick], bool | None]
"""Returns whether it holds in a tick; None = it depends on a value that is not known."""

_TOKEN: Final = re.compile(
    r"""\s*(?:(?P<text>'[^']*'|"[^"]*")|(?P<entry>\{[^{}]+\})|(?P<number>-?\d+(?:\.\d+)?)"""
    r"""|(?P<name>@?[^\W\d][\w./:]*)|(?P<sign>==|!=|<=|>=|&&|\|\||[<>&|!()]))"""
)
_COMPARISONS: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_MAX_TOKENS: Final = 200  # the parser and the propositions are recursive
_WITHIN: Final = re.compile(r"\s+within\s+(\d+)\s+ticks?\s*$")


class QuestionError(BtcoreError):
    """A question cannot be understood."""


class Question(NamedTuple):
    """A question about all runs of a tree.

    Attributes:
        text: The question as written.
        kind: `never`, `leads to` or `before`.
        first: The first proposition.
        second: The second proposition; "" for `never`.
        within: The number of ticks after which the second proposition must hold at the latest, or None.
    """

    text: str
    kind: str
    first: str
    second: str = ""
    within: int | None = None


def parse_question(text: str) -> Question:
    """Return the question in *text*: `never A`, `A leads to B` (`within 5 ticks`) or `A before B`.

    Raises:
        QuestionError: The text is not a question.
    """
    stripped = text.strip()
    if re.match(r"never\b", stripped):
        return Question(stripped, "never", stripped.removeprefix("never").strip())
    limit = _WITHIN.search(stripped)
    body = stripped[: limit.start()] if limit else stripped
    for kind in ("leads to", "before"):
        first, separator, second = body.partition(f" {kind} ")
        if separator:
            if limit and kind == "before":
                break
            return Question(stripped, kind, first.strip(), second.strip(), int(limit[1]) if limit else None)
    raise QuestionError(
        f"'{stripped}' is not a question: write 'never A', 'A leads to B', 'A leads to B within 5 ticks' or "
        "'A before B'"
    )


class ParsedProposition(NamedTuple):
    """A proposition, and the nodes whose results it needs."""

    holds: Proposition
    nodes: list[TreeNode]


def parse_proposition(text: str, tree: Tree) -> ParsedProposition:
    """Return the proposition in *text*.

    `Move` holds if the node Move is RUNNING after the tick, `Move is SUCCESS` if it returned SUCCESS in the
    tick, `Move ticked` and `Move halted` if this happened in the tick. `{battery} < 20` compares an entry
    after the tick. `!`, `&`, `|` and parentheses connect propositions. A name with spaces is put in quotes.

    Args:
        tree: The tree whose nodes the proposition names, by path or unique name.

    Raises:
        QuestionError: The text has an error, or the tree has no such node.
    """
    return _Parser(text, tree).parse()


class _Parser:
    def __init__(self, text: str, tree: Tree) -> None:
        self._text = text
        self._tree = tree
        self._tokens: list[tuple[str, str]] = []
        self._nodes: list[TreeNode] = []
        place = 0
        while text[place:].strip():
            match = _TOKEN.match(text, place)
            if match is None:
                raise QuestionError(f"'{text}': cannot read '{text[place:].strip()}'")
            self._tokens.append((str(match.lastgroup), match[str(match.lastgroup)]))
            place = match.end()
            if len(self._tokens) > _MAX_TOKENS:
                raise QuestionError(f"a proposition has more than {_MAX_TOKENS} words and signs")

    def parse(self) -> ParsedProposition:
        holds = self._either()
        if self._tokens:
            raise QuestionError(f"'{self._text}': '{self._tokens[0][1]}' is not expected here")
        return ParsedProposition(holds, self._nodes)

    def _accept(self, *signs: str) -> bool:
        if self._tokens and self._tokens[0][1] in signs and self._tokens[0][0] in ("sign", "name"):
            self._tokens.pop(0)
            return True
        return False

    def _either(self) -> Proposition:
        first = self._both()
        while self._accept("|", "||", "or"):
            second = self._both()
            first = _or(first, second)
        return first

    def _both(self) -> Proposition:
        first = self._not()
        while self._accept("&", "&&", "and"):
            second = self._not()
            first = _and(first, second)
        return first

    def _not(self) -> Proposition:
        if self._accept("!", "not"):
            inner = self._not()
            return _not(inner)
        if self._accept("("):
            inner = self._either()
            if not self._accept(")"):
                raise QuestionError(f"'{self._text}': a ')' is missing")
            return inner
        return self._atom()

    def _atom(self) -> Proposition:
        if not self._tokens:
            raise QuestionError(f"'{self._text}': the name of a node or a {{key}} is missing at the end")
        token_type, text = self._tokens.pop(0)
        if token_type == "entry":
            return self._comparison(text[1:-1])
        if token_type not in ("name", "text"):
            raise QuestionError(f"'{self._text}': '{text}' is not the name of a node")
        try:
            node = self._tree.node(text.strip("'\""))
        except BtcoreError as error:
            raise QuestionError(f"'{self._text}': {error}") from error
        if self._accept("ticked"):
            self._nodes.append(node)
            return lambda tick: node.config.uid in tick.results
        if self._accept("halted"):
            self._nodes.append(node)
            return lambda tick: node.config.uid in tick.halts
        if self._accept("is"):
            return self._status(node)
        return lambda tick: node._status is RUNNING

    def _status(self, node: TreeNode) -> Proposition:
        name = self._tokens.pop(0)[1] if self._tokens else ""
        if name not in Status.__members__:
            names = ", ".join(Status.__members__)
            raise QuestionError(f"'{self._text}': '{name}' is not a status: write one of {names}")
        status = Status[name]
        if status in (Status.RUNNING, Status.IDLE):
            return lambda tick: node._status is status
        self._nodes.append(node)
        return lambda tick: status in tick.results.get(node.config.uid, ())

    def _comparison(self, key: str) -> Proposition:
        sign = self._tokens.pop(0)[1] if self._tokens else ""
        compare = _COMPARISONS.get(sign)
        if compare is None or not self._tokens:
            raise QuestionError(f"'{self._text}': compare {{{key}}} with a value, as in {{{key}}} == 'low'")
        token_type, text = self._tokens.pop(0)
        value: object
        if token_type == "text":
            value = text[1:-1]
        elif token_type == "number":
            value = float(text)
        elif text in ("true", "false"):
            value = text == "true"
        else:
            value = text
        board = self._tree.blackboard

        def holds(tick: Tick) -> bool | None:
            held = board.get(key)
            if held is None:
                return False
            try:
                if isinstance(value, str) and not isinstance(held, str):
                    entry = board.find(key)
                    assert entry is not None
                    held = entry.declared.to_text(held)
                elif isinstance(held, str) and not isinstance(value, str):
                    held = _number_in(held)
                return bool(compare(held, value))
            except TypeError:
                return False
            except UnknownValueError:
                return None

        return holds


def _number_in(text: str) -> float | None:
    """Return the number that *text* stands for in a comparison with a number, as in scripts, or None."""
    if text in ("true", "false"):
        return float(text == "true")
    try:
        return float(text)
    except ValueError:
        return None


def _not(inner: Proposition) -> Proposition:
    def holds(tick: Tick) -> bool | None:
        truth = inner(tick)
        return None if truth is None else not truth

    return holds


def _or(first: Proposition, second: Proposition) -> Proposition:
    def holds(tick: Tick) -> bool | None:
        truth = first(tick)
        if truth:
            return True
        other = second(tick)
        return None if truth is None and not other else other

    return holds


def _and(first: Proposition, second: Proposition) -> Proposition:
    return _not(_or(_not(first), _not(second)))
