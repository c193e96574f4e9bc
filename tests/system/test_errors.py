"""What the user can fix is an `InputError`; errors of libraries called from this package are not."""

import ast
from pathlib import Path

import numpy as np
import pytest
from joblib import Parallel, delayed

import repro
from repro.metrics.bootstrap import by_world
from repro.recordings.reader import open_recordings
from repro.system.errors import InputError

SOURCE = Path(repro.__file__).parent


def test_an_error_in_a_worker_process_stays_one_of_the_input(tmp_path):
    with pytest.raises(InputError, match="no complete recordings"):
        Parallel(n_jobs=2)(delayed(open_recordings)(tmp_path) for _ in range(2))


def test_an_error_of_a_library_is_not_one_of_the_input():
    with pytest.raises(ValueError, match="cannot reshape") as raised:
        by_world(np.zeros((3, 2)))
    assert not isinstance(raised.value, InputError)


def test_the_package_raises_no_plain_value_error():
    raised = [
        f"{path}:{node.lineno}"
        for path in SOURCE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and ast.unparse(node.exc.func) == "ValueError"
    ]
    assert raised == []
