"""The same tree is a colcon workspace, and a node starts from its install space.

The messages are taken from the environment, which built them from the same CMake package: `make
colcon` builds them with colcon too.
"""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# The ROS wheels restart Python with this set, once for a whole family of processes: so it has to be
# handed down.
LIBRARIES = os.environ.get("LD_LIBRARY_PATH") or f"{sys.prefix}/lib"
LEFT_OUT = shutil.ignore_patterns(
    ".git",
    ".venv",
    "build",
    "install",
    "log",
    "runs",
    ".*_cache",
    ".hypothesis",
    "__pycache__",
    "*.egg-info",
)


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    colcon = Path(sys.executable).with_name("colcon")
    if not colcon.exists():
        pytest.skip("colcon is not installed in this environment")
    source = tmp_path_factory.mktemp("colcon") / "pianobot"
    shutil.copytree(ROOT, source, ignore=LEFT_OUT)
    command = [str(colcon), "build", "--paths", ".", "--event-handlers", "console_direct+"]
    environment = {
        **os.environ,
        "AMENT_PREFIX_PATH": sys.prefix,
        "CMAKE_PREFIX_PATH": sys.prefix,
        "LD_LIBRARY_PATH": LIBRARIES,
        "PATH": f"{colcon.parent}:{os.environ['PATH']}",
    }
    listed = subprocess.run(
        [str(colcon), "list", "--names-only", "--paths", ".", "msg_schemas"],
        cwd=source,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert set(listed.stdout.split()) == {"pianobot_msgs", "pianobot_ros"}
    build = subprocess.run(
        command,
        cwd=source,
        env=environment,
        capture_output=True,
        text=True,
        timeout=1000,
        check=False,
    )
    assert build.returncode == 0, build.stdout[-3000:] + build.stderr[-3000:]
    return source


@pytest.mark.long
def test_a_node_starts_from_the_install_space(workspace: Path, ros_domain: int) -> None:
    executables = {p.name for p in (workspace / "install/pianobot_ros/lib/pianobot_ros").iterdir()}
    nodes = {
        "ur5_wrist",
        "vacuum_regulator",
        "fsr_reader",
        "midi_bridge",
        "sim_twin",
        "optimizer",
        "conductor",
    }
    assert nodes | {"gap_monitor", "gap_diagnoser", "recorder", "viewer"} <= executables
    # Two processes from the install space, with nothing of the source tree on their path: a node,
    # and a client that
    # asks the graph for it.
    look = (
        "import rclpy, time, sys; rclpy.init(); n = rclpy.create_node('looker'); end ="
        " time.monotonic() + 400\nwhile time.monotonic() < end and 'conductor' not in"
        " n.get_node_names(): rclpy.spin_once(n, timeout_sec=0.1)\nimport pianobot_ros;"
        " print(pianobot_ros.__file__); sys.exit('conductor' not in n.get_node_names())"
    )
    node = "install/pianobot_ros/lib/pianobot_ros/conductor"
    python = shlex.quote(sys.executable)
    isolated = "-P" if sys.version_info >= (3, 11) else "-s"
    script = (
        f'. install/setup.sh && {{ {node} & node=$!; }} && {python} {isolated} -c "{look}";'
        " found=$?; "
    )
    script += "kill -INT $node; wait $node; echo node ended with $?; exit $found"
    environment = {
        **{k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "COLCON_PREFIX_PATH")},
        "AMENT_PREFIX_PATH": sys.prefix,
        "LD_LIBRARY_PATH": LIBRARIES,
        "ROS_DOMAIN_ID": str(ros_domain),
    }
    process = subprocess.Popen(
        ["sh", "-c", script],
        cwd=workspace,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        output, _ = process.communicate(timeout=600)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        output, _ = process.communicate()
        pytest.fail(f"no answer:\n{output[-3000:]}")
    assert process.returncode == 0, output[-3000:]
    assert str(workspace / "install") in output
