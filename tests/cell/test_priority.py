"""What a process asks the scheduler for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = (
    "from pianobot_ros.cell.host.priority import request_high; import os\n"
    "print(request_high(), os.nice(0), open('/proc/self/autogroup').read())"
)


@pytest.mark.skipif(not Path("/proc/self/autogroup").exists(), reason="no autogroups here")
@pytest.mark.parametrize("own", [True, False])
def test_who_leads_a_session_goes_first_with_all_of_it(own: bool) -> None:
    """Nice values count within a session only: a node had starved beside other sessions."""
    before = Path("/proc/self/autogroup").read_text().split()[-1]
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        start_new_session=own,
        capture_output=True,
        text=True,
        check=True,
        env=os.environ,
    )
    allowed, nice, _, _, group = done.stdout.split()
    if allowed != "True":
        pytest.skip("no CAP_SYS_NICE")
    assert nice == "-10"
    assert group == ("-10" if own else before), "somebody else's session stays as it is"
