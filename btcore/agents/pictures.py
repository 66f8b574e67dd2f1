"""Convert SVG drawings of trees to PNG, if a program for it is installed."""

import base64
import shutil
import subprocess
from pathlib import Path
from typing import Final

import anyio

MAX_SVG: Final = 1_000_000
"""The maximum size of a drawing (bytes)."""

_PROGRAMS: Final = (
    ("rsvg-convert", "--zoom=1.5", "--output={png}", "{svg}"),
    ("resvg", "--zoom=1.5", "{svg}", "{png}"),
)
_SECONDS: Final = 20.0


async def svg_to_png(svg: Path) -> str | None:
    """Return the PNG of a drawing in base64, or None if no program can convert it."""
    png = svg.with_suffix(".png")
    for program, *arguments in _PROGRAMS:
        path = shutil.which(program)
        if path is None:
            continue
        command = [path, *(argument.format(svg=svg, png=png) for argument in arguments)]
        with anyio.move_on_after(_SECONDS):
            done = await anyio.run_process(
                command, check=False, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL
            )
            if done.returncode == 0 and png.is_file():
                return base64.b64encode(png.read_bytes()).decode()
    return None
