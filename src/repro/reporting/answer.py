"""The answer of a study, which comes first: how close it is to the paper, and the paper's two effects.

Obstacles that move, and a projection without time decay, lower the specificity, the share of obstacle pixels found.
"""

import pandas as pd

from repro.baselines.titles import rank
from repro.reporting.names import model_title
from repro.reporting.paper import read_paper
from repro.reporting.render import Cells, number
from repro.reporting.tables import averages_of
from repro.runs.config import PROJECTION, PROJECTION_NO_DECAY
from repro.runs.keys import CELL
from repro.runs.model import NETWORKS

CLOSE = ("accuracy", "specificity")
TWINS = {"1": "3", "2": "4"}  # the experiment with standing obstacles, and the one with moving ones


def beside_paper(results: pd.DataFrame) -> pd.DataFrame:
    """Return `CLOSE` of the paper's networks and of their average, ours and the paper's, by experiment and encoding.

    Returns:
        columns (`ours` or `paper`, metric), index `CELL`, means over seeds; empty without a run in the paper's worlds.
    """
    if results.empty:
        return pd.DataFrame()
    is_compared = results["model"].isin(NETWORKS) & results["encoding"].isin([PROJECTION, PROJECTION_NO_DECAY])
    rows = results[is_compared & results.get("papers_worlds", pd.Series(True, results.index)).ne(False)]
    ours = pd.concat([rows, averages_of(rows)]).groupby(CELL)[list(CLOSE)].mean()
    paper = read_paper().set_index(CELL)[list(CLOSE)]
    return pd.concat({"ours": ours, "paper": paper}, axis=1, join="inner")


def decay_effect(results: pd.DataFrame) -> pd.DataFrame:
    """Return what the time decay adds to each metric, (`with`, `without` or `difference`, `ours` or `paper`, metric).

    The index is experiment and model, of those that are evaluated with and without.
    """
    found = beside_paper(results)
    if found.empty:
        return found
    of = {name: found[found.index.get_level_values("encoding") == name] for name in (PROJECTION, PROJECTION_NO_DECAY)}
    parts = {name: rows.droplevel("encoding") for name, rows in of.items()}
    both = pd.concat({"with": parts[PROJECTION], "without": parts[PROJECTION_NO_DECAY]}, axis=1, join="inner")
    effect = pd.concat([both, pd.concat({"difference": both["with"] - both["without"]}, axis=1)], axis=1)
    return effect.sort_index(key=lambda keys: keys.map(rank) if keys.name == "model" else keys)


def decay_table(results: pd.DataFrame) -> Cells:
    """Return the effect of the decay on the specificity, a row per experiment and network; none without both."""
    effect = decay_effect(results)
    rows = []
    for experiment, model in effect.index:
        ours, papers = (
            effect.loc[(experiment, model)].xs((of, "specificity"), level=(1, 2)) for of in ("ours", "paper")
        )
        cells = (f"{number(ours[part])} ({number(papers[part])})" for part in ("with", "without", "difference"))
        rows.append((experiment, model_title(model), *cells))
    heads = ("Exp.", "Model", "Spec. with decay", "without", "Difference")
    return Cells(heads, rows, "Effect of the time decay on the specificity.", " Ours (paper).", text_columns=2)


def answer(results: pd.DataFrame) -> list[str]:
    """Return sentences on how close the results are to the paper, and on its two effects; none without such runs."""
    found = beside_paper(results)
    if found.empty:
        return []
    networks = found[found.index.get_level_values("model") != "average"]
    gaps = (networks["ours"] - networks["paper"]).agg(["mean", "min", "max"])
    sentences = [
        f"{metric.capitalize()} differs from the paper's by {gaps.loc['mean', metric]:+.3f} on average, "
        f"{gaps.loc['min', metric]:+.3f} to {gaps.loc['max', metric]:+.3f} ({len(networks)} networks and experiments)."
        for metric in CLOSE
    ]
    for name, ours, paper in effects(found):
        more = "fewer" if ours < 0 else "more"
        change = f"{100 * abs(ours):.1f} percentage points {more} of the obstacle pixels"
        sentences.append(f"{name}, the networks find {change} (paper: {-100 * paper:.1f} fewer).")
    return sentences


def effects(found: pd.DataFrame) -> list[tuple[str, float, float]]:
    """Return the mean change of the specificity by each effect, ours and the paper's, see `beside_paper`.

    It is over the networks with both runs, and over the experiments.
    """
    spec = found.xs("specificity", axis=1, level=1)
    spec = spec[spec.index.get_level_values("model") != "average"].reset_index()
    usual = spec[spec["encoding"] == PROJECTION]
    moving = spec[spec["encoding"] == PROJECTION_NO_DECAY].merge(usual, on=["experiment", "model"])
    still = usual.assign(experiment=usual["experiment"].map(TWINS)).merge(usual, on=["experiment", "model"])
    changes = {
        "Where obstacles move": still[["ours_y", "paper_y"]].to_numpy() - still[["ours_x", "paper_x"]].to_numpy(),
        "Without the time decay": moving[["ours_x", "paper_x"]].to_numpy() - moving[["ours_y", "paper_y"]].to_numpy(),
    }
    return [(name, *map(float, change.mean(0))) for name, change in changes.items() if len(change)]  # type: ignore[misc]


def effects_line(results: pd.DataFrame) -> str:
    """Return the two effects as one line; empty without runs that show one."""
    found = beside_paper(results)
    shown = [] if found.empty else effects(found)
    changes = "; ".join(f"{name.lower()} {ours:+.2f} (paper {paper:+.2f})" for name, ours, paper in shown)
    return f"specificity, the share of obstacle pixels found: {changes}" if changes else ""
