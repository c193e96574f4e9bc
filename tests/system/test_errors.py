"""Which errors are about the input: those that this package raises, not those of libraries called from it."""

import numpy as np
import pytest
from joblib import Parallel, delayed

from repro.metrics.bootstrap import by_world
from repro.recordings.reader import read_manifest
from repro.system.errors import is_about_input


def test_an_error_that_the_package_raises_is_about_the_input(tmp_path):
    with pytest.raises(ValueError, match="no complete recordings") as raised:
        read_manifest(tmp_path)
    assert is_about_input(raised.value)


def test_so_is_one_that_a_worker_process_raises(tmp_path):
    with pytest.raises(ValueError, match="no complete recordings") as raised:
        Parallel(n_jobs=2)(delayed(read_manifest)(tmp_path) for _ in range(2))
    assert is_about_input(raised.value)


def test_an_error_of_compiled_code_is_not():
    """NumPy raises it without a frame of its own."""
    with pytest.raises(ValueError, match="cannot reshape") as raised:
        by_world(np.zeros((3, 2)))
    assert not is_about_input(raised.value)
