"""Compiled functions: kept between processes where there is a place, compiled anew where there is none."""

import subprocess
import sys

from conftest import ROOT

CALL = """
import numpy as np
from repro.maps import visibility
visibility._turned(np.array([1.0, 0.0]), (1.0, 0.0))
print(sum(visibility._turned.stats.cache_hits.values()))
"""


def hits_of(**environment: str) -> str:
    command = [sys.executable, "-c", CALL]
    result = subprocess.run(
        command, cwd=ROOT / "src", capture_output=True, text=True, check=True, env={"PATH": "/usr/bin", **environment}
    )
    return result.stdout.strip()


def test_a_function_is_compiled_once(tmp_path):
    cache = {"NUMBA_CACHE_DIR": str(tmp_path)}
    assert hits_of(**cache) == "0"
    assert hits_of(**cache) == "1"
