"""A figure of five windows of logs, chosen by how well a network ranks their pixels and not by their look."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.networks.predictor import Predictor
from repro.prediction.agreement import last_hits
from repro.prediction.drawing import shade
from reproduce.real.logs import Case, cases_of
from reproduce.real.maps import BOOSTING, Fitted

SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of all windows, that are ranked worse than the drawn one
TITLES = ("hits of the window, dark is recent", "held-out hits (red), passed (blue)", "network", BOOSTING)
HIT, PASSED = "#b3261e", "#0b6e99"


def draw(ranked: dict[Path, list[float]], of_log: dict[Path, Predictor], fitted: dict[Path, Fitted]) -> Figure:
    """Draw the windows at `SHARES` of the AUROC: input, truth of held-out beams, network, boosting.

    Args:
        ranked: AUROC of the network in each window of each log.
        of_log: the network that is tested with each log.
        fitted: the maps without a network, by log.
    """
    every = [(value, path, place) for path, values in ranked.items() for place, value in enumerate(values)]
    every = sorted(each for each in every if np.isfinite(each[0]))
    chosen = [every[round(share * (len(every) - 1))] for share in SHARES]
    figure = Figure(figsize=(10, 2.5 * len(chosen)), layout="constrained")
    axes = figure.subplots(len(chosen), len(TITLES), squeeze=False)
    for ax, title in zip(axes[0], TITLES, strict=True):
        ax.set_title(title, fontsize=9)
    for row, (value, path, place) in zip(axes, chosen, strict=True):
        case = next(case for number, case in enumerate(cases_of(path, of_log[path])) if number == place)
        _draw_row(row, case, of_log[path], fitted[path])
        row[0].set_ylabel(f"{path.name.split('.')[0].removesuffix('-corrected')}\nAUROC {value:.3f}", fontsize=8)
    return figure


def _draw_row(row: np.ndarray, case: Case, predictor: Predictor, fitted: Fitted) -> None:
    grid, scans = predictor.grid, case.window.scans
    network = case.map_of(predictor)
    pixels = np.arange(grid.size_px**2)
    boosting = fitted.predict(case.evidence(grid), pixels)[BOOSTING].reshape(network.shape)
    hits = Projection().encode(scans.batched(), grid)[0, 0] / 255
    truth = np.ones((*network.shape, 3))
    for shown, color in ((case.clear.passed, PASSED), (case.clear.hits, HIT)):
        truth[shown] = to_rgb(color)
    _, seen = last_hits(scans, grid, case.range_max_m)
    maps = (shade(image, ~seen) for image in (hits, network, boosting))  # tinted where unknown
    for ax, image in zip((row[0], *row[2:], row[1]), (*maps, truth), strict=True):
        _show(ax, image, grid, scans.poses[:, :2])


def _show(ax: Axes, image: np.ndarray, grid: Grid, path: np.ndarray) -> None:
    extent = (0, grid.size_m, 0, grid.size_m)
    ax.imshow(image, extent=extent, interpolation="nearest")
    ax.plot(*path.T, color="#e08a00", linewidth=1)
    ax.set(xticks=[], yticks=[], xlim=extent[:2], ylim=extent[2:])
