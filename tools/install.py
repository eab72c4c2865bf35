"""Install every locked requirement into the virtual environment that runs this.

With uv, which does it in a tenth of pip's time; where there is no uv, or it cannot, with pip, which
then says why. Of pip's configuration uv reads nothing, so it is told what concerns it.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from requirements import requirements

LOCK = ("--constraint", "constraints.txt")
PIP = (sys.executable, "-m", "pip", "install", "--quiet", "--no-compile", *LOCK)
UV = (sys.executable, "-m", "uv", "pip", "install", "--quiet", "--python", sys.executable, *LOCK)
FLAGS = {
    "index-url": "--index-url",
    "extra-index-url": "--extra-index-url",
    "find-links": "--find-links",
    "constraint": "--constraint",
    "trusted-host": "--allow-insecure-host",
}
"""Options of pip whose values, separated by blanks, uv takes one by one."""
VARIABLES = {"cert": ("SSL_CERT_FILE",), "proxy": ("HTTP_PROXY", "HTTPS_PROXY")}
SECTIONS = ("global", "install", ":env:")
"""Where pip finds an option; the later one counts."""


def main() -> int:
    """Exit code of whichever installed last."""
    tools = ["pip", "setuptools", "wheel"]
    if subprocess.run([*PIP, "uv"], stderr=subprocess.DEVNULL, check=False).returncode == 0:
        flags, variables = told(configuration())
        with_uv = subprocess.run(
            [*UV, *flags, *tools, *requirements()],
            env={**os.environ, **variables},
            stderr=subprocess.DEVNULL,
            check=False,
        )
        if with_uv.returncode == 0:
            return 0
        print("uv could not install what is needed; pip takes longer …", flush=True)
    return (
        subprocess.run([*PIP, *tools], check=False).returncode
        or subprocess.run([*PIP, *requirements()], check=False).returncode
    )


def configuration() -> str:
    """What `pip config list` prints: a line for each option, as section.option='values'."""
    listed = subprocess.run(
        [sys.executable, "-m", "pip", "config", "list"],
        capture_output=True,
        text=True,
        check=False,
    )
    return listed.stdout


def told(listed: str) -> tuple[list[str], dict[str, str]]:
    """Arguments and environment variables by which uv does what pip's configuration says."""
    options: dict[str, str] = {}
    for section in SECTIONS:
        pattern = rf"^{re.escape(section)}\.([\w-]+)=(['\"])(.*)\2$"
        options |= {m[1]: m[3] for m in re.finditer(pattern, listed, flags=re.MULTILINE)}
    # As pip does, the best release of any index counts.
    flags = ["--index-strategy", "unsafe-best-match"]
    for option, flag in FLAGS.items():
        for value in options.get(option, "").split():
            flags += [flag, value]
    if options.get("no-index", "").lower() in ("1", "true", "yes", "on"):
        flags.append("--no-index")
    variables = {n: options[o] for o, names in VARIABLES.items() if o in options for n in names}
    return flags, variables


if __name__ == "__main__":
    sys.exit(main())
