"""Triangles of the mesh files that a URDF draws: STL, as text or binary, and Wavefront OBJ."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from btcore_sim.errors import SimError

Floats = NDArray[np.float64]

MAX_TRIANGLES = 20_000
"""Greatest number of triangles in a file; more would slow the viewer down."""
_MAX_BYTES = 20_000_000
_HEADER = (
    84  # bytes before the triangles of a binary STL file: 80 of any content, and the number of triangles
)
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_triangles(path: Path) -> Floats:
    """Return the triangles of a mesh file.

    Args:
        path: The file; its suffix is `.stl` or `.obj`.

    Returns:
        The corners of the triangles in the file's units, counter-clockwise seen from outside, shape
        `(n, 3, 3)`.

    Raises:
        SimError: The file cannot be read, has another format, or too many triangles.
    """
    readers = {".stl": _read_stl, ".obj": _read_obj}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise SimError(f"{path}: meshes of this format are not drawn: use STL or OBJ")
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise SimError(f"{path}: the mesh has more than {_MAX_BYTES // 1_000_000} MB")
        triangles = reader(path.read_bytes())
    except OSError as error:
        raise SimError(f"{path}: cannot read the mesh: {error.strerror}") from None
    except (ValueError, IndexError):
        raise SimError(f"{path}: not a valid {path.suffix[1:].upper()} file") from None
    if len(triangles) > MAX_TRIANGLES:
        raise SimError(
            f"{path}: the mesh has {len(triangles)} triangles, but only {MAX_TRIANGLES} are drawn: "
            "reduce it with a mesh editor"
        )
    if not len(triangles) or not np.isfinite(triangles).all():
        raise SimError(f"{path}: the mesh has no triangles, or corners that are not finite")
    return triangles


def _read_stl(data: bytes) -> Floats:
    count = int.from_bytes(data[_HEADER - 4 : _HEADER], "little")
    # A text file may be long enough to have a number there, but then the sizes differ.
    if len(data) == _HEADER + count * _TRIANGLE.itemsize:
        rows = np.frombuffer(data, dtype=_TRIANGLE, offset=_HEADER)
        return rows["corners"].astype(np.float64)
    words = (line.split() for line in data.decode("utf-8").splitlines())
    corners = [[float(word) for word in line[1:4]] for line in words if line[:1] == ["vertex"]]
    return np.array(corners, dtype=np.float64).reshape(-1, 3, 3)


def _read_obj(data: bytes) -> Floats:
    points: list[tuple[float, ...]] = []
    triangles: list[tuple[int, int, int]] = []
    for line in data.decode("utf-8", errors="replace").splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            points.append(tuple(float(word) for word in words[1:4]))
        elif words[:1] == ["f"]:
            # An index counts from 1, or backwards from the last point; texture and normal follow a slash.
            indices = [int(word.split("/")[0]) for word in words[1:]]
            face = [index - 1 if index > 0 else len(points) + index for index in indices]
            if min(face) < 0:
                raise ValueError(line)
            triangles += [(face[0], face[k], face[k + 1]) for k in range(1, len(face) - 1)]
    if not triangles:
        return np.zeros((0, 3, 3))
    corners: Floats = np.array(points, dtype=np.float64).reshape(-1, 3)[np.array(triangles)]
    return corners
