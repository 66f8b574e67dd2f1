"""The log of all requests of an agent."""

import json
import time
from collections.abc import Mapping
from typing import Any, Final, TextIO

from mcp.server.context import CallNext, HandlerResult, ServerRequestContext

from btcore_studio.agents.result_size import shorten_text

_LONGEST: Final = 1000


class CallLog:
    """A middleware that writes a line of JSON for each request: its parameters, duration and outcome.

    Args:
        file: The file.
    """

    def __init__(self, file: TextIO) -> None:
        self._file = file

    async def __call__(self, ctx: ServerRequestContext[Any, Any], call_next: CallNext) -> HandlerResult:
        """Let the rest of the server handle a request, and write the line."""
        if ctx.request_id is None:
            return await call_next(ctx)  # a notification
        began = time.monotonic()
        outcome: dict[str, object] = {"outcome": "cancelled"}
        try:
            result = await call_next(ctx)
            outcome = _outcome_of(result)
            return result
        except Exception as error:
            outcome = {"outcome": "error", "message": shorten_text(str(error), _LONGEST)}
            raise
        finally:
            line = {
                "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
                "method": shorten_text(ctx.method, _LONGEST),
                "parameters": _bounded(ctx.params or {}),
                "seconds": round(time.monotonic() - began, 3),
                **outcome,
            }
            self._file.write(json.dumps(line) + "\n")
            self._file.flush()


def _outcome_of(result: HandlerResult) -> dict[str, object]:
    """Return whether a request was refused, and the size of the result (characters)."""
    if result is None or isinstance(result, dict):
        data = result or {}
    else:
        data = result.model_dump(mode="json", by_alias=True, exclude_none=True)
    size = {"size": len(json.dumps(data))}
    if not data.get("isError"):
        return {"outcome": "ok", **size}
    return {"outcome": "refused", "message": shorten_text(data["content"][0]["text"], _LONGEST), **size}


def _bounded(parameters: Mapping[str, Any]) -> object:
    """Return parameters for the log: as JSON data, or as the beginning of their text if they are long."""
    named = {key: value for key, value in parameters.items() if key != "_meta"}
    text = json.dumps(named, default=str)
    return named if len(text) <= _LONGEST else shorten_text(text, _LONGEST)
