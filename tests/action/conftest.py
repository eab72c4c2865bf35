from __future__ import annotations

import pytest

from pianobot_ros.action import ActionParameters, load_parameters


@pytest.fixture(scope="session")
def parameters() -> ActionParameters:
    return load_parameters()
