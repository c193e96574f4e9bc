"""A figure of five windows of logs, chosen by how well a network ranks their pixels and not by their look."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.metrics.counts import LEVELS
from repro.networks.predictor import Predictor
from repro.prediction.agreement import last_hits
from repro.prediction.drawing import shade
from reproduce.real.evidence import CENTER, evidence_at, regression_map
from reproduce.real.fitting import Fitted, counts_of
from reproduce.real.logs import Case, cases_of
from reproduce.real.measures import auroc

SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of all windows, that are ranked worse than the drawn one
TITLES = (
    "hits of the window, dark is recent",
    "held-out hits (red), passed (blue)",
    "network",
    "regression with continued walls",
)
HIT, PASSED = "#b3261e", "#0b6e99"


def choose(networks: dict[Path, np.ndarray], predictor: Predictor) -> list[tuple[float, Path, int]]:
    """Return the AUROC, the log and the place in it of the windows at `SHARES` of the AUROC of the network.

    Args:
        networks: levels of the network at the compared pixels of all windows of each log, (P,).
        predictor: the network before any adaptation, which cuts the windows.
    """
    ranked = []
    for path, levels in networks.items():
        first = 0
        for place, case in enumerate(cases_of(path, predictor)):
            last = first + len(case.pixels)
            ranked.append((float(auroc(counts_of(levels[first:last], case.free))), path, place))
            first = last
    ranked = sorted(each for each in ranked if np.isfinite(each[0]))
    return [ranked[round(share * (len(ranked) - 1))] for share in SHARES]


def draw(chosen: list[tuple[float, Path, int]], of_log: dict[Path, Predictor], fitted: dict[str, Fitted]) -> Figure:
    """Draw each chosen window in a row: its input, the truth of held-out beams, the network, the regression."""
    figure = Figure(figsize=(10, 2.5 * len(chosen)), layout="constrained")
    axes = figure.subplots(len(chosen), len(TITLES), squeeze=False)
    for ax, title in zip(axes[0], TITLES, strict=True):
        ax.set_title(title, fontsize=9)
    for row, (score, path, place) in zip(axes, chosen, strict=True):
        case = next(case for number, case in enumerate(cases_of(path, of_log[path])) if number == place)
        _draw_row(row, case, of_log[path], fitted[path.name])
        row[0].set_ylabel(f"{path.name.split('.')[0].removesuffix('-corrected')}\nAUROC {score:.3f}", fontsize=8)
    return figure


def _draw_row(row: np.ndarray, case: Case, predictor: Predictor, fitted: Fitted) -> None:
    grid, scans = predictor.grid, case.window.scans
    network = case.map_of(predictor)
    evidence = evidence_at(case, grid, np.arange(grid.size_px**2))
    regression = regression_map(evidence, fitted.model)[:, CENTER].reshape(network.shape)
    hits = Projection().encode(scans.batched(), grid)[0, 0]
    truth = np.ones((*network.shape, 3))
    for pixels, color in ((case.clear.passed, PASSED), (case.clear.hits, HIT)):
        truth[pixels] = to_rgb(color)
    _, seen = last_hits(scans, grid, case.range_max_m)
    maps = (shade(image, ~seen) for image in (hits / 255, network, regression / (LEVELS - 1)))  # tinted where unknown
    for ax, image in zip((row[0], *row[2:], row[1]), (*maps, truth), strict=True):
        _show(ax, image, grid, scans.poses[:, :2])


def _show(ax: Axes, image: np.ndarray, grid: Grid, path: np.ndarray) -> None:
    extent = (0, grid.size_m, 0, grid.size_m)
    ax.imshow(image, extent=extent, interpolation="nearest")
    ax.plot(*path.T, color="#e08a00", linewidth=1)
    ax.set(xticks=[], yticks=[], xlim=extent[:2], ylim=extent[2:])
