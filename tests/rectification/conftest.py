"""A textured world, made once."""

import pytest
from stereo_rigs import World


@pytest.fixture(scope="session")
def world():
    return World()
