"""Comparisons of the cells of an analysis: the average of the paper's networks, and differences with intervals."""

import itertools
from collections.abc import Iterator

import numpy as np

from repro.config import NO_DECAY, PROJECTION
from repro.metrics.bootstrap import Difference, Measured, differences, resample
from repro.networks.model import NETWORKS

Cell = tuple[str, str, str]  # experiment, model, encoding
PAPERS_METHOD = ("unet", PROJECTION)  # the paper's best model and its input


def averages(
    counted: dict[Cell, Measured], seeds: dict[Cell, list[int | None]], weights: np.ndarray
) -> Iterator[tuple[Cell, dict[str, np.ndarray], int]]:
    """Yield the mean of the paper's networks in every draw, for each encoding on which all of them are evaluated.

    It is taken over the seeds that all four have, as in the tables; the last value is their number.
    """
    for experiment, encoding in dict.fromkeys((cell[0], cell[2]) for cell in counted):
        cells: list[Cell] = [(experiment, name, encoding) for name in NETWORKS]
        if not all(cell in counted for cell in cells):
            continue
        common = [seed for seed in seeds[cells[0]] if all(seed in seeds[cell] for cell in cells)]
        if not common:
            continue
        draws = []
        for cell in cells:
            chosen = [seeds[cell].index(seed) for seed in common]
            per_world = {name: values[chosen] for name, values in counted[cell].per_world.items()}
            draws.append(resample(Measured(counted[cell].counts[chosen], per_world), weights))
        yield (
            (experiment, "average", encoding),
            {name: np.mean([each[name] for each in draws], axis=0) for name in draws[0]},
            len(common),
        )


def compared(draws: dict[Cell, dict[str, np.ndarray]]) -> Iterator[tuple[list[Difference], dict[str, str]]]:
    """Yield the differences between models on the same encoding, the decay and its ablation, encodings, and methods.

    Args:
        draws: the metrics in every draw of the bootstrap, by cell.

    Yields:
        the difference of each metric, and the columns that identify them.
    """
    for one, other in itertools.combinations(draws, 2):
        comparison = _comparison(one, other)
        if comparison == "networks":
            names = {"one": one[1], "other": other[1], "model": "", "encoding": one[2] or other[2]}
        elif comparison == "methods":
            names = {"one": "/".join(one[1:]), "other": "/".join(other[1:]), "model": "", "encoding": ""}
        elif comparison:
            names = {"one": one[2], "other": other[2], "model": one[1], "encoding": ""}
        else:
            continue
        yield differences(draws[one], draws[other]), {"experiment": one[0], "comparison": comparison, **names}


def _comparison(one: Cell, other: Cell) -> str | None:
    """Name the difference between two cells; None if it is of no interest.

    Networks have the same input, or one is a baseline, which has none. Methods differ in network and input, and one is
    the paper's U-Net.
    """
    encodings = one[2], other[2]
    has_decay = [not encoding.endswith(NO_DECAY) for encoding in encodings]
    if one[1] == other[1]:
        bases = {encoding.removesuffix(NO_DECAY) for encoding in encodings}
        return "decay" if len(bases) == 1 else "encodings" if has_decay[0] == has_decay[1] else None
    if encodings[0] == encodings[1] or ("" in encodings and all(has_decay)):
        return "networks"
    return "methods" if PAPERS_METHOD in (one[1:], other[1:]) and all(has_decay) else None
