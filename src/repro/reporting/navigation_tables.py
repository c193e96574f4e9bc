"""The comparison of the mappers of task=navigate: tables, and the figure of success against time to goal."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from repro.metrics.bootstrap import bounds, draw_weights
from repro.navigation.trials import CURVE, ORIGIN, TEST, TRIED, spl
from repro.reporting.names import predictor_title
from repro.reporting.plots import INK, MARKERS, STYLE, columns, one_legend, save
from repro.system.files import read_mapping, write_json, write_text

TITLES = {
    "scan": "Current scan",
    "keep": "Hits until a beam passes",
    "decay": "Hits for a time",
    "log_odds": "Log-odds grid",
    "tracker": "Tracker, constant velocity",
    "full_circle": "Hits of a lidar of 360 degrees",
    "truth": "True map",
    "true_velocities": "True map and velocities",
}  # networks stand before the lidar of 360 degrees
BEST_OF = ("scan", "keep", "decay", "log_odds", "tracker")  # the classical mappers with the robot's lidar
ALL = "all"  # experiments together
COLORS = (*(f"C{number}" for number in range(10)), INK)


def write_results(episodes: Path, analysis: Path) -> pd.DataFrame:
    """Write navigation.csv, tuned settings, curve, episodes, figure and provenance of all mappers that are finished.

    Args:
        episodes: directory of the files of every mapper, see `navigation.trials`.
        analysis: directory of the analysis of the outputs.

    Returns:
        the rows of navigation.csv, see `compare_mappers`.
    """
    mappers = mappers_of(path.parent.name for path in episodes.glob(f"*/{ORIGIN}"))
    test, curve, tried = (
        pd.concat(
            [pd.read_csv(episodes / mapper / name).assign(mapper=mapper) for mapper in mappers], ignore_index=True
        )
        for name in (TEST, CURVE, TRIED)
    )
    results, points = compare_mappers(test), points_of(curve)
    tuned = tried.loc[tried.groupby("mapper", sort=False)["score"].idxmax()]
    analysis.mkdir(parents=True, exist_ok=True)
    tables = {"": results, "_tuned": tuned, "_curve": points, "_episodes": test}
    for stem, table in tables.items():
        write_text(analysis / f"navigation{stem}.csv", table.to_csv(index=False, float_format="%.4g"))
    origins = {mapper: read_mapping(episodes / mapper / ORIGIN, "the provenance of a mapper") for mapper in mappers}
    write_json(analysis / "navigation.json", origins)
    _draw(points, analysis / "navigation")
    return results


def compare_mappers(test: pd.DataFrame) -> pd.DataFrame:
    """Return one row per experiment and mapper, and one for all experiments: how the robots fared.

    Intervals are over the courses. Differences are those to the classical mapper with the most successes in all
    experiments, on the courses that both have; that of the time is over the courses where both succeed.
    """
    test = test.assign(success=(test["outcome"] == "goal").astype(float), spl=spl, barn=barn)
    best = best_classical(test)
    rows = []
    for experiment, of_experiment in [(ALL, test), *test.groupby("experiment", sort=False)]:
        by_mapper = of_experiment.pivot(index=["experiment", "seed"], columns="mapper", values=["success", "time_s"])
        success, time_s = by_mapper["success"], by_mapper["time_s"].where(by_mapper["success"] == 1)
        for mapper in mappers_of(success):
            own = of_experiment[of_experiment["mapper"] == mapper]
            row: dict[str, Any] = {
                "experiment": experiment,
                "mapper": mapper,
                "title": title_of(mapper),
                "episodes": len(own),
            }
            row |= _interval("success", "", success[mapper])
            if best is not None:
                row |= _interval("difference", "difference_", success[mapper] - success[best])
                row["time_difference_s"] = float((time_s[mapper] - time_s[best]).mean())
            if {"scan", "truth"} <= set(success):
                gap = success["truth"].mean() - success["scan"].mean()
                row["share_of_gap"] = (success[mapper].mean() - success["scan"].mean()) / gap if gap else np.nan
            rows.append(row | _measures(own))
    return pd.DataFrame(rows)


def best_classical(test: pd.DataFrame) -> str | None:
    """Return the classical mapper of the robot's own lidar with the most successes, if there is one."""
    classical = test[test["mapper"].isin(BEST_OF)]
    reached = (classical["outcome"] == "goal").groupby(classical["mapper"]).mean()
    return str(reached.idxmax()) if len(reached) else None


def title_of(mapper: str) -> str:
    """Return the title of a mapper; that of a network is named `<model>-<encoding>`."""
    if mapper in TITLES:
        return TITLES[mapper]
    model, _, encoding = mapper.partition("-")
    return predictor_title(model, encoding)


def mappers_of(names: Iterable[str]) -> list[str]:
    """Sort mappers for tables and figures."""
    order = list(TITLES)
    place = order.index("full_circle") - 0.5  # of the networks
    return sorted(names, key=lambda name: (order.index(name) if name in order else place, name))


def barn(test: pd.DataFrame) -> pd.Series:
    """Return the score of the BARN challenge of every episode, at most 0.25 (Xiao et al. 2022)."""
    ideal = test["way_m"] / test["speed_m_s"]
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


def _interval(name: str, prefix: str, values: pd.Series) -> dict[str, float]:
    """Return the mean of values and its interval; courses that were not driven have none."""
    known = values.dropna().to_numpy()
    drawn = draw_weights(len(known)) @ known / len(known)
    low, high = bounds(drawn)
    return {name: float(drawn[0]), f"{prefix}low": float(low), f"{prefix}high": float(high)}


def points_of(curve: pd.DataFrame) -> pd.DataFrame:
    """Return success and mean time of the successes by experiment, mapper and inflation."""
    reached = curve["outcome"] == "goal"
    groups = curve.assign(success=reached, time_s=curve["time_s"].where(reached)).groupby(
        ["experiment", "mapper", "inflation_m"], sort=False
    )
    return groups.agg(episodes=("seed", "size"), success=("success", "mean"), time_s=("time_s", "mean")).reset_index()


def _draw(points: pd.DataFrame, stem: Path) -> None:
    """Draw one panel per experiment and one line per mapper over its inflations."""
    with plt.rc_context(STYLE):
        figure, axes = columns(points, 1, sharey=True)
        figure.set_size_inches(3.1 * axes.shape[1], 4.2)
        for ax, (experiment, rows) in zip(axes[0], points.groupby("experiment", sort=False), strict=True):
            for number, mapper in enumerate(mappers_of(points["mapper"].unique())):
                own = rows[rows["mapper"] == mapper].sort_values("inflation_m")
                look: Any = {"color": COLORS[number % len(COLORS)], "marker": MARKERS[number % 8], "ms": 4, "lw": 1}
                ax.plot(own["time_s"], own["success"], label=title_of(mapper), **look)
            ax.set(title=experiment, xlabel="time to the goals [s]")
        axes[0, 0].set_ylabel("share that reaches the goals")
        one_legend(figure, axes[0], rows=3)
        save(figure, stem)
