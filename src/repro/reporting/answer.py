"""The answer of a study, which comes first: how close it is to the paper, and the paper's two effects.

Obstacles that move, and a projection without time decay, lower the specificity, the share of obstacle pixels found.
"""

from dataclasses import dataclass

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
    rows = results[is_compared & results["papers_worlds"].ne(False)]
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
    trained = "1 trained network" if len(networks) == 1 else f"{len(networks)} trained networks"
    sentences = [
        f"{metric.capitalize()} differs from the paper's by {gaps.loc['mean', metric]:+.3f} on average, "
        f"{gaps.loc['min', metric]:+.3f} to {gaps.loc['max', metric]:+.3f} ({trained})."
        for metric in CLOSE
    ]
    for effect in effects(found):
        who = f"{model_title(*effect.models)} finds" if len(effect.models) == 1 else "the networks find on average"
        change = f"{100 * abs(effect.ours):.1f} percentage points {'fewer' if effect.ours < 0 else 'more'}"
        sentences.append(
            f"{effect.name}, {who} {change} of the obstacle pixels (paper: {-100 * effect.paper:.1f} fewer)."
        )
    return sentences


@dataclass(frozen=True)
class Effect:
    """A change of the specificity.

    Args:
        name: what changes it.
        models: the networks that have runs with and without.
        ours: mean over them and the experiments.
        paper: the same of the paper's.
    """

    name: str
    models: frozenset[str]
    ours: float
    paper: float


def effects(found: pd.DataFrame) -> list[Effect]:
    """Return the paper's two effects, of those that two runs show, see `beside_paper`."""
    spec = found.xs("specificity", axis=1, level=1)
    spec = spec[spec.index.get_level_values("model") != "average"].reset_index()
    usual = spec[spec["encoding"] == PROJECTION]
    moving = spec[spec["encoding"] == PROJECTION_NO_DECAY].merge(usual, on=["experiment", "model"])
    still = usual.assign(experiment=usual["experiment"].map(TWINS)).merge(usual, on=["experiment", "model"])
    pairs = {"Where obstacles move": (still, "y", "x"), "Without the time decay": (moving, "x", "y")}
    shown = []
    for name, (rows, after, before) in pairs.items():
        if len(rows):
            ours, paper = ((rows[f"{of}_{after}"] - rows[f"{of}_{before}"]).mean() for of in ("ours", "paper"))
            shown.append(Effect(name, frozenset(rows["model"]), ours, paper))
    return shown


def effects_line(results: pd.DataFrame) -> str:
    """Return the two effects as one line; empty without runs that show one."""
    found = beside_paper(results)
    shown = [] if found.empty else effects(found)
    changes = "; ".join(f"{effect.name.lower()} {effect.ours:+.2f} (paper {effect.paper:+.2f})" for effect in shown)
    return f"specificity, the share of obstacle pixels found: {changes}" if changes else ""
