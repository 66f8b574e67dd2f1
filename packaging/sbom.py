"""Write the software bill of materials (SBOM) of a release, as CycloneDX 1.6 in JSON.

`python packaging/sbom.py WHEEL FILE` lists the distributions that pip installs at this moment for the wheel
with all extras: names, versions, licences, hashes, and which of them requires which. It installs nothing.
"""

import json
import re
import subprocess
import sys
import uuid
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any


def bill_of_materials(name: str, distributions: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the SBOM of the distribution *name*.

    Args:
        name: The distribution that is released.
        distributions: This distribution and all that it requires, as in the reports of `pip install` and
            `pip inspect`.
    """
    by_name = {_normalized(each["metadata"]["name"]): each for each in distributions}
    references = {key: _package_url(key, each) for key, each in by_name.items()}
    components = {key: _component(key, each, references[key]) for key, each in by_name.items()}
    main = components.pop(_normalized(name))
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": uuid.uuid4().urn,
        "version": 1,
        "metadata": {"timestamp": datetime.now(UTC).isoformat(timespec="seconds"), "component": main},
        "components": [components[key] for key in sorted(components)],
        "dependencies": [
            {
                "ref": references[key],
                "dependsOn": sorted({references[required] for required in _required(each, by_name)}),
            }
            for key, each in sorted(by_name.items())
        ],
    }


def _component(key: str, distribution: Mapping[str, Any], reference: str) -> dict[str, Any]:
    metadata = distribution["metadata"]
    component: dict[str, Any] = {
        "type": "library",
        "bom-ref": reference,
        "name": key,
        "version": metadata["version"],
        "purl": reference,
    }
    if licence := metadata.get("license_expression"):
        component["licenses"] = [{"expression": licence}]
    hashes = distribution.get("download_info", {}).get("archive_info", {}).get("hashes", {})
    if "sha256" in hashes:
        component["hashes"] = [{"alg": "SHA-256", "content": hashes["sha256"]}]
    return component


def _required(distribution: Mapping[str, Any], by_name: Iterable[str]) -> set[str]:
    """Return the requirements of *distribution* in *by_name*, without those of extras of other packages."""
    metadata = distribution["metadata"]
    requirements = [
        requirement
        for requirement in metadata.get("requires_dist", ())
        if "extra ==" not in requirement or _normalized(metadata["name"]) == "btcore"
    ]
    names = {_normalized(re.split(r"[^\w.-]", requirement, maxsplit=1)[0]) for requirement in requirements}
    return names.intersection(by_name) - {_normalized(metadata["name"])}


def _package_url(key: str, distribution: Mapping[str, Any]) -> str:
    return f"pkg:pypi/{key}@{distribution['metadata']['version']}"


def _normalized(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def main(wheel: str, file: str) -> None:
    """Write the SBOM of *wheel* to *file*."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--dry-run"]
    command += ["--ignore-installed", "--report", "-", f"{wheel}[all]"]
    report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    bill = bill_of_materials("btcore", report["install"])
    Path(file).write_text(json.dumps(bill, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
