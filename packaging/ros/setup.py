"""Install the pure build of btcore in a colcon workspace. The folders beside this file are links to it."""

import os
import tomllib
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

HERE = Path(__file__).resolve().parent  # `colcon build --symlink-install` runs a link to this file
ROOT = HERE.parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
NAME = PROJECT["name"]
# Data folders of btcore: beside the package in a checkout, inside the package in an installation.
DATA = ("docs", "trees")
FOLDERS = sorted(
    {
        path.parent.relative_to(ROOT)
        for folder in DATA
        for path in (ROOT / folder).rglob("*")
        if path.suffix in {".md", ".py", ".xml"}
    }
)
# `ros2 run btcore NAME` starts `btcore ros2 NAME`; see btcore_ros2/executables.py.
EXECUTABLES = ("btcore", "doctor", "navigation", "navigator", "serve", "sim")


def files(folder: str) -> list[str]:
    """Return the files of a folder beside this file, relative to it."""
    return sorted(f"{folder}/{path.name}" for path in (HERE / folder).iterdir())


setup(
    name=NAME,
    version=ElementTree.parse(HERE / "package.xml").findtext("version"),
    description=PROJECT["description"],
    license=PROJECT["license"],
    packages=[*find_packages(include=["btcore*"]), *(".".join([NAME, *folder.parts]) for folder in FOLDERS)],
    package_dir={f"{NAME}.{folder}": os.path.relpath(ROOT / folder) for folder in DATA},
    package_data={
        **PYPROJECT["tool"]["setuptools"]["package-data"],
        **{".".join([NAME, *folder.parts]): ["*.md", "*.xml"] for folder in FOLDERS},
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml", "README.md"]),
        (f"share/{NAME}/config", files("config")),
        (f"share/{NAME}/launch", files("launch")),
        ("bin", files("bin")),
    ],
    python_requires=PROJECT["requires-python"],
    install_requires=PROJECT["dependencies"],
    entry_points={
        "console_scripts": [f"{name} = btcore_ros2.executables:main" for name in EXECUTABLES],
        **{
            group: [f"{name} = {target}" for name, target in points.items()]
            for group, points in PROJECT["entry-points"].items()
        },
    },
    zip_safe=False,
)
