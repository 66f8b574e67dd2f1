"""The systemd unit in docs/guides/deployment.md is valid."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs/guides/deployment.md"


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd isn't installed")
def test_the_systemd_unit_is_valid(tmp_path: Path) -> None:
    text = PAGE.read_text(encoding="utf-8")
    units = re.findall(r"```ini.*?\n(.*?)```", text, re.DOTALL)
    full, variant = (unit.replace("/opt/robot/.venv/bin/", f"{tmp_path}/") for unit in units)
    for name in ("python", "btcore"):
        (tmp_path / name).symlink_to(sys.executable)
    service = re.sub(r"(?m)^(Type|ExecStart|RestartPrevent\w+|WatchdogSec)=.*\n", "", full)
    for number, unit in enumerate([full, service.replace("[Service]\n", f"[Service]\n{variant}")]):
        path = tmp_path / f"robot{number}.service"
        path.write_text(unit, encoding="utf-8")
        done = subprocess.run(
            ["systemd-analyze", "verify", "--man=no", str(path)], capture_output=True, text=True, check=False
        )
        assert (done.returncode, [line for line in done.stderr.splitlines() if path.name in line]) == (0, [])
