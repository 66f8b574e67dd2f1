"""Parse scripts with the operator precedences of BehaviorTree.CPP, and run the programs."""

from collections.abc import Mapping
from typing import Final

from btcore.blackboard.blackboard import Blackboard
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
from btcore.values import as_bool, number_of
from btcore.values.numbers import MAX_INT64, leading_float

# The operators by precedence: level 1 binds the loosest, the last level the tightest.
_OPERATORS: Final = (":= = += -= *= /=", "?", "||", "&&", "== != < > <= >=", "| ^", "&", "+ - ..", "* /")
_PRECEDENCE: Final[dict[str, int]] = {
    operator: level for level, operators in enumerate(_OPERATORS, start=1) for operator in operators.split()
}
_LOWEST: Final = 0
_ASSIGNMENT: Final = 1
_CONDITIONAL: Final = 2
_COMPARISON: Final = 5
# Bounds the recursion of the parser and of the evaluation.
_MAX_DEPTH: Final = 200


class Parser:
    """A parser of one script, which is a sequence of statements."""

    def __init__(self, text: str, enums: Mapping[str, int]) -> None:
        self.text: str = text
        self.enums: Mapping[str, int] = enums
        self.tokens: list[Token] = tokenize(text)
        self.position: int = 0
        self.depth: int = 0

    def parse(self) -> list[Expression]:
        """Parse all statements, each followed by any number of `;`. Raise ScriptError."""
        statements: list[Expression] = []
        while self._peek().type != END:
            statements.append(self._parse_expression(_LOWEST))
            # As in BehaviorTree.CPP, a statement may also follow without a semicolon.
            while self._peek().type == ";":
                self.position += 1
        if not statements:
            raise ScriptError("the script is empty; write an expression, such as a := 1", self.text)
        return statements

    def _peek(self) -> Token:
        return self.tokens[self.position]

    def _advance(self) -> Token:
        token = self.tokens[self.position]
        if token.type != END:
            self.position += 1
        return token

    def _parse_expression(self, min_precedence: int) -> Expression:
        """Parse a value, and the operators after the value of at least *min_precedence*."""
        self.depth += 1
        if self.depth > _MAX_DEPTH:
            raise self._error(self._peek(), f"the expression is nested more than {_MAX_DEPTH} deep")
        first = self._peek()
        signs: list[str] = []
        while self._peek().type in ("-", "~", "!"):
            signs.append(self._advance().type)
        left = self._parse_value()
        if signs:
            left = UnaryOperation(self.text, first, signs, left)
        while True:
            token = self._peek()
            precedence = _PRECEDENCE.get(token.type, -1)
            if precedence < min_precedence:
                break
            if precedence == _COMPARISON:
                left = comparison = Comparison(self.text, self._peek(), left, self.enums)
                while _PRECEDENCE.get(self._peek().type, -1) == _COMPARISON:
                    token = self._advance()
                    comparison.extend(token, self._parse_expression(_COMPARISON + 1))
                continue
            self.position += 1
            if precedence == _ASSIGNMENT:
                left = Assignment(self.text, token, left, self._parse_expression(_LOWEST), self.enums)
                break
            if precedence == _CONDITIONAL:
                left = self._parse_conditional(token, left)
                break
            chain = left if isinstance(left, OperatorChain) else OperatorChain(self.text, token, left)
            # A tighter level for the right operand, because equal levels are evaluated from left to right.
            chain.extend(token, self._parse_expression(precedence + 1))
            left = chain
        self.depth -= 1
        return left

    def _parse_conditional(self, question: Token, condition: Expression) -> Expression:
        then = self._parse_expression(_LOWEST)
        colon = self._advance()
        if colon.type != ":":
            raise self._unexpected(colon, f"expected ':' to follow the '?' in column {question.start + 1}")
        return ConditionalExpression(
            self.text, question, condition, then, self._parse_expression(_CONDITIONAL)
        )

    def _parse_value(self) -> Expression:
        token = self._advance()
        token_type = token.type
        if token_type == NAME:
            return Name(self.text, token, self.enums)
        if token_type == STRING:
            return Literal(self.text, token, token.text)
        if token_type == BOOLEAN:
            return Literal(self.text, token, 1.0 if token.text == "true" else 0.0)
        if token_type == INTEGER:
            return Literal(self.text, token, _integer(token.text))
        if token_type == REAL:
            try:
                return Literal(self.text, token, leading_float(token.text))
            except ConversionError as error:
                raise self._error(token, str(error)) from None
        if token_type == "(":
            inner = self._parse_expression(_LOWEST)
            close = self._advance()
            if close.type != ")":
                raise self._unexpected(close, f"expected ')' to close the '(' in column {token.start + 1}")
            return inner
        raise self._unexpected(token, "expected a value")

    def _unexpected(self, token: Token, expected: str) -> ScriptError:
        if token.type == END:
            return self._error(token, f"{expected}, but the script ends")
        if token.type != MALFORMED:
            return self._error(token, f"{expected}, but found '{token.text}'")
        if token.text.startswith("'"):
            return self._error(token, "the string has no closing quote")
        if token.text == '"':
            return self._error(token, "strings are written between single quotes: '…'")
        if token.text[0] in "0123456789":
            return self._error(token, f"'{token.text}' is not a number; examples: 12, 0x1F, 1.5, 1e3")
        return self._error(token, f"unexpected character '{token.text}'")

    def _error(self, token: Token, message: str) -> ScriptError:
        return ScriptError(message, self.text, token.start + 1, token.width)


def _integer(digits: str) -> int:
    """Return the value of the literal; 0 for more than 63 bits, as in BehaviorTree.CPP."""
    hexadecimal = digits[1:2] in ("x", "X")
    bare = (digits[2:] if hexadecimal else digits).lstrip("0") or "0"
    if len(bare) > 19:
        return 0
    value = int(bare, 16 if hexadecimal else 10)
    return value if value <= MAX_INT64 else 0


class Program:
    """A compiled script; *text* is its source, and *enums* are the enum names that it may use."""

    def __init__(self, text: str, statements: list[Expression], enums: Mapping[str, int]) -> None:
        self.text = text
        self.enums = enums
        self._statements: list[Expression] = statements

    def run(self, blackboard: Blackboard) -> object:
        """Evaluate all statements on *blackboard*, and return the value of the last statement.

        The value is a number, a text, any other value of an entry, or None for an entry without a value.

        Raises:
            ScriptError: A statement cannot be evaluated. The assignments before it remain.
        """
        recorder = blackboard.recorder
        if recorder is None or not recorder.begin_script(blackboard, self.text, self.enums):
            return self._evaluate(blackboard)
        try:
            return self._evaluate(blackboard)
        finally:
            recorder.end_script()

    def _evaluate(self, blackboard: Blackboard) -> object:
        value: object = None
        for statement in self._statements:
            value = statement.evaluate(blackboard)
        return value


def compile_script(text: str, enums: Mapping[str, int] | None = None) -> Program:
    """Parse a script.

    Args:
        text: The source of the script.
        enums: The enum names with their numbers. Names may be added later: every run reads the mapping.

    Returns:
        The program, which can be run on any blackboard.

    Raises:
        ScriptError: The script has a syntax error; the exception gives the column.

    Examples:
        >>> import btcore
        >>> board = btcore.Blackboard()
        >>> board["n"] = 3
        >>> btcore.compile_script("n * 2 + 1").run(board)
        7.0
    """
    names = {} if enums is None else enums
    return Program(text, Parser(text, names).parse(), names)


def condition_result(value: object) -> bool:
    """Return the result of a condition's script as a bool.

    Zero is false. The integer 1 and every positive float are true.
    """
    if isinstance(value, float) and value >= 0.0:
        return value != 0.0
    number = number_of(value)
    if number is None:
        problem = "has no value" if value is None else f"is not a number: {value!r}"
        raise ScriptError(f"the result of a condition {problem}")
    try:
        return as_bool(number)
    except ConversionError as error:
        raise ScriptError(f"the result of a condition is not a bool: {error}") from None
