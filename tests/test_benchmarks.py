"""Every benchmark runs with a tiny size, and reports ratios; `make bench` measures them."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"
NEEDS = {
    "batch": ("numpy",),
    "laser": ("pybullet",),
    "navigation_localising": ("scipy", "cv2", "pybullet"),
    "navigation_planning": ("scipy", "cv2", "skimage", "pybullet"),
    "publishing": ("zmq", "msgpack", "flatbuffers"),
    "robot": ("scipy", "cv2", "pybullet"),
    "ros2": ("rclpy",),
    "studio": ("playwright", "pygls", "websockets"),
}
FILES = sorted(BENCHMARKS.glob("*.py"))


@pytest.mark.parametrize("file", FILES, ids=[file.stem for file in FILES])
def test_a_benchmark_runs(file: Path) -> None:
    for module in NEEDS.get(file.stem, ()):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} isn't installed")
    command = [sys.executable, str(file), "--quick", "--pairs", "1", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    reported: dict[str, Any] = json.loads(done.stdout)
    assert reported["benchmark"] == file.stem
    if file.stem == "studio" and not reported["rows"]:
        pytest.skip(reported["remarks"][0])
    assert reported["rows"]
    assert all(0 < row["low"] <= row["median"] <= row["high"] for row in reported["rows"])
    if file.stem == "ticking" and importlib.util.find_spec("py_trees") is not None:
        rows = {row["what"]: row for row in reported["rows"]}
        for tree in ("bump-and-go", "deep", "wide"):
            assert "target" in rows[f"{tree}, class leaves: py_trees / btcore"]
        assert "wide, class leaves: btcore / the loop" in rows
