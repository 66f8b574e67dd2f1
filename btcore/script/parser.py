"""The parser of scripts: tokens → syntax tree, with the operator precedences of BehaviorTree.CPP."""

from collections.abc import Mapping
from typing import Final

from btcore.errors import ConversionError, ScriptError
from btcore.script.expressions import (
    Assignment,
    Comparison,
    ConditionalExpression,
    Expression,
    Literal,
    Name,
    OperatorChain,
    UnaryOperation,
)
from btcore.script.lexer import BOOLEAN, END, INTEGER, MALFORMED, NAME, REAL, STRING, Token, tokenize
from btcore.values.numbers import MAX_INT64, leading_float

# How tightly an operator binds what stands to its left. The right side of one that goes from left
# to right must bind tighter than itself.
_ASSIGNING: Final = 1
_CHOOSING: Final = 2
_COMPARING: Final = 5
_BINDING: Final[dict[str, int]] = {
    ":=": _ASSIGNING,
    "=": _ASSIGNING,
    "+=": _ASSIGNING,
    "-=": _ASSIGNING,
    "*=": _ASSIGNING,
    "/=": _ASSIGNING,
    "?": _CHOOSING,
    "||": 3,
    "&&": 4,
    "==": _COMPARING,
    "!=": _COMPARING,
    "<": _COMPARING,
    ">": _COMPARING,
    "<=": _COMPARING,
    ">=": _COMPARING,
    "|": 6,
    "^": 6,
    "&": 7,
    "+": 8,
    "-": 8,
    "..": 8,
    "*": 9,
    "/": 9,
}
_LOOSEST: Final = 0
_DEEPEST: Final = 200


class Parser:
    """Reads the statements of one script."""

    def __init__(self, text: str, enums: Mapping[str, int]) -> None:
        self.text: str = text
        self.enums: Mapping[str, int] = enums
        self.tokens: list[Token] = tokenize(text)
        self.at: int = 0
        self.depth: int = 0

    def statements(self) -> list[Expression]:
        """Every statement; ``;`` may stand after each, any number of times. Raises ScriptError."""
        found: list[Expression] = []
        while self._next().kind != END:
            found.append(self._expression(_LOOSEST))
            while self._next().kind == ";":
                self.at += 1
        if not found:
            raise ScriptError("the script is empty: it needs an expression, say a := 1", self.text)
        return found

    def _next(self) -> Token:
        return self.tokens[self.at]

    def _take(self) -> Token:
        token = self.tokens[self.at]
        if token.kind != END:
            self.at += 1
        return token

    def _expression(self, least: int) -> Expression:
        """A value and all the operators after it that bind at least as tightly as *least*."""
        self.depth += 1
        if self.depth > _DEEPEST:
            raise self._fault(self._next(), f"the expression is nested more than {_DEEPEST} deep")
        left = self._prefixed()
        while True:
            token = self._next()
            binding = _BINDING.get(token.kind, -1)
            if binding < least:
                break
            if binding == _COMPARING:
                left = self._comparison(left)
                continue
            self.at += 1
            if binding == _ASSIGNING:
                left = Assignment(self.text, token, left, self._expression(_LOOSEST), self.enums)
                break
            if binding == _CHOOSING:
                left = self._choice(token, left)
                break
            chain = left if isinstance(left, OperatorChain) else OperatorChain(self.text, token, left)
            chain.extend(token, self._expression(binding + 1))
            left = chain
        self.depth -= 1
        return left

    def _comparison(self, first: Expression) -> Expression:
        comparison = Comparison(self.text, self._next(), first, self.enums)
        while _BINDING.get(self._next().kind, -1) == _COMPARING:
            token = self._take()
            comparison.extend(token, self._expression(_COMPARING + 1))
        return comparison

    def _choice(self, question: Token, condition: Expression) -> Expression:
        then = self._expression(_LOOSEST)
        colon = self._take()
        if colon.kind != ":":
            raise self._unexpected(colon, f"':' is wanted, for the '?' in column {question.start + 1}")
        return ConditionalExpression(self.text, question, condition, then, self._expression(_CHOOSING))

    def _prefixed(self) -> Expression:
        first = self._next()
        signs: list[str] = []
        while self._next().kind in ("-", "~", "!"):
            signs.append(self._take().kind)
        value = self._value()
        return UnaryOperation(self.text, first, signs, value) if signs else value

    def _value(self) -> Expression:
        token = self._take()
        kind = token.kind
        if kind == NAME:
            return Name(self.text, token, self.enums)
        if kind == STRING:
            return Literal(self.text, token, token.text)
        if kind == BOOLEAN:
            return Literal(self.text, token, 1.0 if token.text == "true" else 0.0)
        if kind == INTEGER:
            return Literal(self.text, token, _integer(token.text))
        if kind == REAL:
            try:
                return Literal(self.text, token, leading_float(token.text))
            except ConversionError as fault:
                raise self._fault(token, str(fault)) from None
        if kind == "(":
            inner = self._expression(_LOOSEST)
            close = self._take()
            if close.kind != ")":
                raise self._unexpected(close, f"')' is wanted, for the '(' in column {token.start + 1}")
            return inner
        raise self._unexpected(token, "a value is wanted")

    def _unexpected(self, token: Token, wanted: str) -> ScriptError:
        if token.kind == END:
            return self._fault(token, f"{wanted}, but the script ends here")
        if token.kind != MALFORMED:
            return self._fault(token, f"{wanted}, but '{token.text}' stands here")
        if token.text.startswith("'"):
            return self._fault(token, "the text has no closing quote")
        if token.text == '"':
            return self._fault(token, "a text stands between single quotes: '…'")
        if token.text[0] in "0123456789":
            return self._fault(token, f"'{token.text}' is no number: 12, 0x1F, 1.5 and 1e3 are")
        return self._fault(token, f"'{token.text}' is no word of a script")

    def _fault(self, token: Token, message: str) -> ScriptError:
        return ScriptError(message, self.text, token.start + 1, token.width)


def _integer(digits: str) -> int:
    """The literal's value; one of more than 63 bits is 0, as in the original."""
    hexadecimal = digits[1:2] in ("x", "X")
    bare = (digits[2:] if hexadecimal else digits).lstrip("0") or "0"
    if len(bare) > 19:
        return 0
    value = int(bare, 16 if hexadecimal else 10)
    return value if value <= MAX_INT64 else 0
