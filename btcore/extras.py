"""The hints that name an extra of btcore: the only table of modules that the extras install."""

from typing import Final

# Any package may import this module, also the parts of other packages that do not need the engine.
_MODULES: Final = {
    "bags": ("rosbags",),
    "bench": ("matplotlib", "py_trees"),
    "lsp": ("lsprotocol", "pygls", "websockets"),
    "mcp": ("anyio", "mcp", "resvg_py"),
    "monitor": ("PIL", "flatbuffers", "msgpack", "rerun", "zmq"),
    "record": ("mcap", "zstandard"),
    "robot": ("cv2", "numpy", "scipy", "skimage", "yaml"),  # numpy is in others, too
    "ros2": ("rclpy",),
    "sim": ("pybullet",),
    "sweep": ("dask", "distributed", "pyarrow"),
}
EXTRA_OF: Final = {module: extra for extra, modules in _MODULES.items() for module in modules}
"""The extra that installs a module."""


def install_command(module: str, extra: str | None = None) -> str:
    """Return the command that installs *module*, such as "pip install 'btcore[robot]'".

    Args:
        module: A key of `EXTRA_OF`.
        extra: The extra, if it is not that of the table, because several extras install the module.
    """
    return f"pip install 'btcore[{extra or EXTRA_OF[module]}]'"


def describe_missing(module: str | None) -> str:
    """Return a sentence about *module*, which is not installed, with the command if an extra installs it.

    Args:
        module: The name of a module or of its submodule, as in `ModuleNotFoundError.name`.
    """
    top = (module or "").partition(".")[0]
    command = f"; install it with: {install_command(top)}" if top in EXTRA_OF else ""
    return f"the module '{module}' is not installed{command}"
