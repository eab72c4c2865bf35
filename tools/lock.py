"""Resolve the dependencies for every supported Python and print them as one constraints file.

Lines are ``name==version``; where the versions differ between Pythons, each line says for which it
holds. Packages that are published as source only are listed below.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from requirements import requirements

PYTHONS = ("3.10", "3.11", "3.12", "3.13")
SOURCE_ONLY = {"empy": "3.3.4"}
# No wheels for the newest Python: tools/create_venv.sh gets what they are built with.
SOURCE_FOR = {"3.13": {"python-rtmidi": "1.5.8", "ur-rtde": "1.6.5"}}
TOOLS = ("pip", "setuptools", "uv", "wheel")


def resolve(python: str) -> dict[str, str]:
    """Name and version of everything that pip would install for ``python``."""
    with tempfile.TemporaryDirectory() as folder:
        # pip resolves for another Python from wheels alone, so the few pure Python packages without
        # one are built first.
        pins = [f"{name}=={version}" for name, version in SOURCE_ONLY.items()]
        pip = [sys.executable, "-m", "pip"]
        subprocess.run(
            [*pip, "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, *pins],
            check=True,
            stdout=sys.stderr,
        )
        report = Path(folder) / "report.json"
        command = [
            *pip,
            "install",
            "--dry-run",
            "--quiet",
            "--ignore-installed",
            "--only-binary=:all:",
        ]
        command += ["--python-version", python, "--target", folder, "--report", str(report)]
        built = SOURCE_FOR.get(python, {})
        command += ["--find-links", folder, *(r for r in requirements() if r not in built), *TOOLS]
        subprocess.run(command, check=True, stdout=sys.stderr)
        installs = json.loads(report.read_text(encoding="utf-8"))["install"]
    return built | {
        i["metadata"]["name"].lower().replace("_", "-"): i["metadata"]["version"] for i in installs
    }


def main() -> None:
    """Print the constraints."""
    versions: dict[str, dict[str, str]] = defaultdict(dict)
    for python in PYTHONS:
        for name, version in resolve(python).items():
            versions[name][python] = version
    print("# Written by `make lock`. What `make` installs, for each supported Python.")
    for name, found in sorted(versions.items()):
        if len(found) == len(PYTHONS) and len(set(found.values())) == 1:
            print(f"{name}=={found[PYTHONS[0]]}")
        else:
            for python, version in found.items():
                print(f'{name}=={version}; python_version == "{python}"')


if __name__ == "__main__":
    main()
