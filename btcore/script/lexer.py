"""The lexer of scripts: it splits a text into tokens."""

from typing import Final

# Types of tokens. The type of an operator is its own text.
INTEGER: Final = "integer"
REAL: Final = "real"
STRING: Final = "string"
BOOLEAN: Final = "boolean"
NAME: Final = "name"
MALFORMED: Final = "malformed"
END: Final = "end"

_TWO_CHARACTER_OPERATORS: Final = ("..", "&&", "||", "==", "!=", "<=", ">=", ":=", "+=", "-=", "*=", "/=")
_ONE_CHARACTER_OPERATORS: Final = "+-*/&|^~!<>=?:();"
_WHITESPACE: Final = " \t\n\r"
_DIGITS: Final = "0123456789"
_HEX_DIGITS: Final = "0123456789abcdefABCDEF"
_NAME_START: Final = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz_@"
_NAME_REST: Final = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz_0123456789"


class Token:
    """A token of a script.

    Attributes:
        type: The type of the token; for an operator, its text.
        text: The text; the text of a string is without the quotes.
        start: The index of the first character in the script.
        width: The number of characters in the script.
    """

    def __init__(self, type: str, text: str, start: int, width: int) -> None:
        self.type = type
        self.text = text
        self.start = start
        self.width = width


def tokenize(text: str) -> list[Token]:
    """Return the tokens of *text*, then an END token. Invalid text becomes a MALFORMED token."""
    tokens: list[Token] = []
    size = len(text)
    at = 0
    while at < size:
        char = text[at]
        if char in _WHITESPACE:
            at += 1
            continue
        start = at
        if char == "'":
            close = text.find("'", at + 1)
            if close < 0:
                tokens.append(Token(MALFORMED, text[start:], start, size - start))
                at = size
            else:
                tokens.append(Token(STRING, text[start + 1 : close], start, close + 1 - start))
                at = close + 1
            continue
        if char in _DIGITS:
            token = _number(text, start)
        elif char in _NAME_START:
            at = _skip(text, at + 1, _NAME_REST)
            word = text[start:at]
            token = Token(BOOLEAN if word in ("true", "false") else NAME, word, start, at - start)
        elif text[at : at + 2] in _TWO_CHARACTER_OPERATORS:
            token = Token(text[at : at + 2], text[at : at + 2], start, 2)
        else:
            token = Token(char if char in _ONE_CHARACTER_OPERATORS else MALFORMED, char, start, 1)
        tokens.append(token)
        at = start + token.width
    tokens.append(Token(END, "", size, 1))
    return tokens


def _number(text: str, start: int) -> Token:
    """Return the number that begins at *start*, or a MALFORMED token with the letters that follow it."""
    if text[start] == "0" and text[start + 1 : start + 2] in ("x", "X"):
        first = start + 2
        at = _skip(text, first, _HEX_DIGITS)
        end = _skip(text, at, _NAME_REST + ".")
        is_valid = at > first and end == at
        return Token(INTEGER if is_valid else MALFORMED, text[start:end], start, end - start)
    token_type = INTEGER
    at = _skip(text, start, _DIGITS)
    # "1..2" joins two integers.
    if text[at : at + 1] == "." and text[at + 1 : at + 2] != ".":
        if text[at + 1 : at + 2] not in _DIGITS or at + 1 >= len(text):
            end = _skip(text, at + 1, _NAME_REST + ".")
            return Token(MALFORMED, text[start:end], start, end - start)
        token_type = REAL
        at = _skip(text, at + 1, _DIGITS)
    if at < len(text) and text[at] in "eE":
        token_type = REAL
        at += 1
        if at < len(text) and text[at] in "+-":
            at += 1
        first = at
        at = _skip(text, at, _DIGITS)
        if at == first:
            return Token(MALFORMED, text[start:at], start, at - start)
    if at < len(text) and text[at] in _NAME_START:
        end = _skip(text, at, _NAME_REST)
        return Token(MALFORMED, text[start:end], start, end - start)
    return Token(token_type, text[start:at], start, at - start)


def _skip(text: str, at: int, among: str) -> int:
    """Return the index of the first character, from *at* on, that is not in *among*."""
    while at < len(text) and text[at] in among:
        at += 1
    return at
