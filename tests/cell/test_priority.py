"""What a process asks the scheduler for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

AUTOGROUP = Path("/proc/self/autogroup")
SCRIPT = (
    "from pianobot_ros.cell.host.priority import request_high; import os, pathlib\n"
    "print(request_high(), os.nice(0), pathlib.Path('/proc/self/autogroup').read_text())"
)


def _autogroup() -> str | None:
    """Nice value of this session's autogroup; None where the kernel has none: then the file is
    absent, cannot be read or is empty (as of processes in a control group of their own).
    """
    try:
        words = AUTOGROUP.read_text(encoding="ascii").split()
    except OSError:
        return None
    return words[-1] if words else None


@pytest.mark.skipif(_autogroup() is None, reason="no autogroups here")
@pytest.mark.parametrize("own", [True, False])
def test_who_leads_a_session_goes_first_with_all_of_it(own: bool) -> None:
    """Nice values count within a session only: a node had starved beside other sessions."""
    before = _autogroup()
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        start_new_session=own,
        capture_output=True,
        text=True,
        check=True,
        env=os.environ,
    )
    allowed, nice, *group = done.stdout.split()
    if allowed != "True":
        pytest.skip("no CAP_SYS_NICE")
    assert nice == "-10"
    if not group:
        pytest.skip("no autogroups for processes started here")
    assert group[-1] == ("-10" if own else before), "somebody else's session stays as it is"
