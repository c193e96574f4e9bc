"""The comparison of the arms of task=navigate: tables, and the figure of success against time to goal."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from repro.metrics.bootstrap import DRAWS, LEVEL
from repro.navigation.study import CURVE, ORIGIN, TEST, TRIED, spl
from repro.reporting.plots import MARKERS, STYLE, DataFrames, columns, one_legend, save
from repro.reporting.render import Cells, number, with_interval
from repro.system.files import read_mapping, write_json, write_text

TITLES = {
    "scan": "Current scan",
    "keep": "Hits until a beam passes",
    "decay": "Hits for a time",
    "log_odds": "Log-odds grid",
    "tracker": "Tracker, constant velocity",
    "unet": "U-Net, the paper's image",
    "convgru": "ConvGRU",
    "convgru_hits": "ConvGRU or hits of 1 s",
    "full_circle": "Hits of a lidar of 360 degrees",
    "truth": "True map",
    "true_velocities": "True map and velocities",
}
BEST_OF = ("scan", "keep", "decay", "log_odds", "tracker")  # the classical arms with the robot's lidar
SPEED_M_S = 2.0  # of the robot


def write_results(episodes: Path, analysis: Path) -> pd.DataFrame:
    """Write navigation.csv, its tuned settings, curve, episodes, figure and provenance from the arms that are finished.

    Args:
        episodes: directory of the files of every arm, see `navigation.study`.
        analysis: directory of the analysis of the outputs.

    Returns:
        the rows of navigation.csv, see `compare`.
    """
    arms = [arm for arm in TITLES if (episodes / arm / ORIGIN).is_file()]
    test, curve, tried = (
        pd.concat([pd.read_csv(episodes / arm / name).assign(arm=arm) for arm in arms], ignore_index=True)
        for name in (TEST, CURVE, TRIED)
    )
    results, points = compare(test), points_of(curve)
    tuned = tried.loc[tried.groupby("arm", sort=False)["score"].idxmax()]
    analysis.mkdir(parents=True, exist_ok=True)
    for stem, table in {"": results, "_tuned": tuned, "_curve": points, "_episodes": test}.items():
        write_text(analysis / f"navigation{stem}.csv", table.to_csv(index=False, float_format="%.4g"))
    origins = {arm: read_mapping(episodes / arm / ORIGIN, "the provenance of an arm") for arm in arms}
    write_json(analysis / "navigation.json", origins)
    _draw(points, analysis / "navigation")
    return results


def arms_table(frames: DataFrames, caption: str) -> Cells:
    """Return success, time and difference of all arms, a row each, from navigation.csv."""
    results = frames["navigation"]
    experiments, rows = list(results["experiment"].unique()), []
    for title, own in results.groupby("title", sort=False):
        of = own.set_index("experiment")
        success = [with_interval(*of.loc[name, ["success", "low", "high"]]) for name in experiments]
        last = of.loc[experiments[-1]]
        gain, low, high = last[["difference", "difference_low", "difference_high"]]
        rows.append([title, *success, number(last["time_s"], 1), with_interval(gain, low, high, "+.3f")])
    heads = ["Map", *map(str.capitalize, experiments), "Time [s]", f"{experiments[-1].capitalize()}, minus the best"]
    return Cells(heads, rows, caption)


def compare(test: pd.DataFrame) -> pd.DataFrame:
    """Return one row per experiment and arm: how the robots fared, with intervals over the courses.

    The difference is that to the classical arm with the most successes in all experiments, of the same courses.
    """
    shared = test.groupby("arm")["seed"].nunique().min()
    test = test[test["seed"] < test["seed"].min() + shared].assign(
        success=lambda rows: (rows["outcome"] == "goal").astype(float), spl=spl, barn=barn
    )
    classical = test[test["arm"].isin(BEST_OF)]
    best = classical.groupby("arm")["success"].mean().idxmax() if len(classical) else None
    rows = []
    for experiment, of_experiment in test.groupby("experiment", sort=False):
        success = of_experiment.pivot(index="seed", columns="arm", values="success")
        draws = np.random.default_rng(0).integers(len(success), size=(DRAWS, len(success)))
        for arm in [name for name in TITLES if name in success]:
            own = of_experiment[of_experiment["arm"] == arm]
            row = {"experiment": experiment, "arm": arm, "title": TITLES[arm], "episodes": len(own)}
            row |= _interval("success", "", success[arm].to_numpy(), draws)
            if best is not None:
                row |= _interval("difference", "difference_", (success[arm] - success[best]).to_numpy(), draws)
            if {"scan", "truth"} <= set(success):
                gap = success["truth"].mean() - success["scan"].mean()
                row["share_of_gap"] = (success[arm].mean() - success["scan"].mean()) / gap if gap else np.nan
            rows.append(row | _measures(own))
    return pd.DataFrame(rows)


def barn(test: pd.DataFrame) -> pd.Series:
    """Return the score of the BARN challenge of every episode, at most 0.25 (Xiao et al. 2022)."""
    ideal = test["way_m"] / SPEED_M_S
    return (test["outcome"] == "goal") * ideal / test["time_s"].clip(lower=4 * ideal, upper=8 * ideal)


def _measures(own: pd.DataFrame) -> dict[str, float]:
    reached, hit = own[own["outcome"] == "goal"], own["outcome"] == "collision"
    places = {
        f"hit_{place.replace(' ', '_')}": float((own["contact"] == place).mean())
        for place in ("in view", "beside", "behind")
    }
    return {
        **places,
        "hit_standing": float((hit & own["stood"]).mean()),
        "timeout": float((own["outcome"] == "timeout").mean()),
        "time_s": float(reached["time_s"].mean()),
        "spl": float(own["spl"].mean()),
        "barn": float(own["barn"].mean()),
        "clearance_m": float(reached["clearance_m"].mean()),
        "moving_share": float(own["moving_share"].mean()),
    }


def _interval(name: str, prefix: str, values: np.ndarray, draws: np.ndarray) -> dict[str, float]:
    low, high = np.quantile(values[draws].mean(1), [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return {name: float(values.mean()), f"{prefix}low": float(low), f"{prefix}high": float(high)}


def points_of(curve: pd.DataFrame) -> pd.DataFrame:
    """Return success and mean time of the successes by experiment, arm and inflation."""
    groups = curve.assign(success=curve["outcome"] == "goal").groupby(["experiment", "arm", "inflation_m"], sort=False)
    reached = curve[curve["outcome"] == "goal"].groupby(["experiment", "arm", "inflation_m"], sort=False)
    points = groups.agg(episodes=("seed", "size"), success=("success", "mean"))
    return points.join(reached.agg(time_s=("time_s", "mean"))).reset_index()


def _draw(points: pd.DataFrame, stem: Path) -> None:
    """Draw one panel per experiment and one line per arm over its inflations."""
    with plt.rc_context(STYLE):
        figure, axes = columns(points, 1, sharey=True)
        figure.set_size_inches(3.1 * axes.shape[1], 4.2)
        for ax, (experiment, rows) in zip(axes[0], points.groupby("experiment", sort=False), strict=True):
            for number, arm in enumerate(arm for arm in TITLES if arm in set(points["arm"])):
                own = rows[rows["arm"] == arm].sort_values("inflation_m")
                look: Any = {"color": f"C{number % 10}", "marker": MARKERS[number % 8], "ms": 4, "lw": 1}
                ax.plot(own["time_s"], own["success"], label=TITLES[arm], **look)
            ax.set(title=experiment, xlabel="time to the goals [s]")
        axes[0, 0].set_ylabel("success without collision")
        one_legend(figure, axes[0], rows=3)
        save(figure, stem)
