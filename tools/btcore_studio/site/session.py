"""The language server of the studio in a browser, where Python runs in a Web Worker.

There are neither processes nor threads: documents are checked in the server's own process, and no node
library of a user is imported. The nodes of btcore's libraries that need other packages, such as numpy, are
known by their models.
"""

import gc
import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

from btcore.json_text import load_json
from btcore_studio.language.server import GC_THRESHOLD, create_server
from btcore_studio.language.worker import Worker, WorkerSettings

MODELS: Final = Path(__file__).with_name("models.json")
"""The models of btcore's libraries, which the build of the site writes."""


class LocalWorker:
    """Checks documents in this process, and trusts no node library.

    Args:
        models: A file with the models of nodes and with enums, or None.
    """

    def __init__(self, models: Path | None = None) -> None:
        self._models = models
        self._worker: Worker | None = None

    @classmethod
    async def start(cls, models: Path | None = None) -> "LocalWorker":
        """Return a worker, which gets its settings by the first message."""
        return cls(models)

    async def ask(self, message: Mapping[str, Any], limit: float) -> dict[str, Any]:
        """Return the answer to *message*. *limit* is not used: the user ends what takes too long."""
        if self._worker is None:
            settings = WorkerSettings(**message)._replace(trusted=False)
            if self._models is not None:
                # The worker takes them for the nodes of libraries that cannot be imported.
                known = json.loads(self._models.read_text(encoding="utf-8"))
                settings = settings._replace(last_models=known["models"], last_enums=known["enums"])
            self._worker = Worker(settings)
            return self._worker.describe()
        return self._worker.answer(message)

    def stop(self) -> None:
        """Do nothing: there is no process."""

    async def wait(self) -> None:
        """Do nothing: there is no process."""


class SiteSession:
    """The language server of one page.

    Args:
        post: Sends a message of JSON-RPC to the page.
        models: A file with the models of btcore's libraries, or None.
    """

    def __init__(self, post: Callable[[str], object], models: Path | None = MODELS) -> None:
        gc.set_threshold(GC_THRESHOLD)
        gc.enable()
        self._post = post
        self._protocol = create_server(
            start_worker=partial(LocalWorker.start, models), has_processes=False
        ).protocol
        # pygls sends by `write` of this object.
        self._protocol.set_writer(self, include_headers=False)

    def receive(self, message: str) -> None:
        """Handle a message of JSON-RPC from the page."""
        self._protocol.handle_message(self._protocol.structure_message(load_json(message)))

    def write(self, data: bytes) -> None:
        """Send a message."""
        self._post(data.decode())

    def close(self) -> None:
        """Do nothing: the page ends the Web Worker."""
