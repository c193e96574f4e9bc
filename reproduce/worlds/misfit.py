"""The misfit of a study: how far its tables are from the paper's, in units of the tolerances of the claims."""

from pathlib import Path

import numpy as np
import pandas as pd

from repro.metrics.headings import METRICS
from repro.reporting.paper import read_paper
from repro.reporting.papers_claims import LEVEL
from repro.reporting.results import read_published
from repro.runs.config import PROJECTION, PROJECTION_NO_DECAY
from repro.runs.model import NETWORKS
from reproduce.worlds.families import MOVING, STATIC

CELL = ["experiment", "encoding"]
PARTS = {"all": STATIC + MOVING, "static": STATIC, "moving": MOVING}
MOTIONS = {"ssim_rotation": ("1", "3"), "ssim_square": ("2", "4")}
RESULTS = Path(__file__).parents[1] / "results"
STUDIES = [  # scale, row of its tables
    *(("paper", "unet"), ("protocol128", "unet"), ("workstation256", "unet")),
    *(("workstation256", "average"), ("workstation", "average"), ("laptop", "average")),
]


def papers(model: str) -> pd.DataFrame:
    """Return the paper's rows of a network or of the average, by experiment and encoding."""
    return read_paper().query("model == @model").set_index(CELL)[[*METRICS]]


def ours(scale: str, model: str) -> pd.DataFrame:
    """Return the published rows of a network, or the average of the paper's four, over seeds, as `papers`."""
    rows = read_published(RESULTS / scale)
    named = rows["model"].isin(NETWORKS if model == "average" else [model])
    chosen = rows[named & rows["encoding"].isin([PROJECTION, PROJECTION_NO_DECAY])]
    return chosen.groupby([*CELL, "model"])[[*METRICS]].mean().groupby(CELL).mean()


def misfits(rows: pd.DataFrame, model: str = "unet") -> dict[str, float]:
    """Compare rows by experiment and encoding with the paper's of the same model.

    Returns:
        the root mean square of the differences in units of the tolerances, over all metrics but SSIM, in all cells, in
        those with static and with moving obstacles; `least`, in all cells, if those that are missing were the paper's;
        `with_ssim`, in all cells with SSIM; `ssim_rotation` and `ssim_square`, the mean ratios of the paper's SSIM to
        that of the rows, by the motion of the robot. What else needs a missing cell is nan.
    """
    paper = papers(model)
    apart = (rows.reindex(paper.index) - paper) / pd.Series(LEVEL)
    fitted = apart.drop(columns="ssim")
    found = {part: _rms(fitted.loc[list(experiments)]) for part, experiments in PARTS.items()}
    ratio = paper["ssim"] / rows["ssim"].reindex(paper.index)
    motions = {motion: float(ratio.loc[list(own)].mean(skipna=False)) for motion, own in MOTIONS.items()}
    return {**found, "least": _rms(fitted.fillna(0)), "with_ssim": _rms(apart), **motions}


def _rms(values: pd.DataFrame) -> float:
    return float(np.sqrt((values.to_numpy() ** 2).mean()))


def published() -> pd.DataFrame:
    """Return the misfits of the published studies in the worlds of paper.yaml, one row each."""
    return pd.DataFrame(
        [{"scale": scale, "model": model, **misfits(ours(scale, model), model)} for scale, model in STUDIES]
    )
