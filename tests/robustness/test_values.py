"""Values without meaning and files without an end are refused, each where it is given."""

import os

import numpy as np
import pytest

import repro
from repro.logs.readings import readings
from repro.maps.encodings import create_encoding
from repro.maps.validity import check_windows
from repro.networks.predictor import load_predictor
from repro.scans import Scans
from repro.system.arrays import open_arrays
from repro.system.errors import InputError
from repro.system.files import read_mapping

GRID = repro.Grid(32, 50.0)


def window(angles: np.ndarray) -> Scans:
    return Scans(np.full((10, len(angles)), 5.0), angles, np.full((10, 3), 25.0) * [1, 1, 0]).batched()


VALUES = {
    "a grid of half a pixel": lambda: repro.Grid(32.5, 50.0),
    "a grid of no pixels": lambda: repro.Grid(0, 50.0),
    "a grid of text": lambda: repro.Grid("32", 50.0),
    "a grid without a size": lambda: repro.Grid(32, np.nan),
    "a grid of no size": lambda: repro.Grid(32, 0.0),
    "an infinite grid": lambda: repro.Grid(32, np.inf),
    "a grid of more than 10 km": lambda: repro.Grid(32, 10_001.0),
    "readings without a maximum": lambda: readings(np.ones(3), 0.0, np.nan),
    "readings of a negative maximum": lambda: readings(np.ones(3), 0.0, -3.0),
    "readings of a minimum above the maximum": lambda: readings(np.ones(3), 5.0, 3.0),
    "beams over one turn and a half": lambda: check_windows(window(np.linspace(-1.5, 1.5, 91) * np.pi), GRID),
    "misses of 1e39 m": lambda: create_encoding("series10", {"frames": 10, "range_max_m": 1e39}),
}


@pytest.mark.parametrize("make", VALUES.values(), ids=VALUES)
def test_a_value_without_meaning_is_refused(make):
    with pytest.raises(InputError):
        make()


@pytest.mark.parametrize("name", ["pipe", "/dev/zero"])
def test_a_file_without_an_end_is_not_read(name, tmp_path):
    path = tmp_path / name
    if name == "pipe":
        os.mkfifo(path)
    reads = {
        "weights": lambda: load_predictor(path),
        "mapping": lambda: read_mapping(path, "restore it"),
        "arrays": lambda: open_arrays(path).__enter__(),
    }
    for read in reads.values():
        with pytest.raises(InputError):
            read()
