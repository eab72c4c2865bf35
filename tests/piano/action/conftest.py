from __future__ import annotations

import pytest

from pianobot_ros.piano.action import ActionParameters, load_parameters


@pytest.fixture(scope="session")
def parameters() -> ActionParameters:
    return load_parameters()
