"""What all tests share."""

import numpy as np
import pytest

SEED = 20231002


@pytest.fixture
def rng() -> np.random.Generator:
    """A seeded generator; the seed is in this file, so a failure can be repeated."""
    return np.random.default_rng(SEED)
