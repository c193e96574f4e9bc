"""The comparison of the mappers of task=navigate: tables, and the figure of the scores of the settings."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from repro.metrics.bootstrap import bounds, draw_weights
from repro.navigation.surfaces import Surface, settings_of, spl
from repro.navigation.trials import EPISODES, ORIGIN
from repro.reporting.names import predictor_title
from repro.reporting.plots import INK, MARKERS, STYLE, one_legend, save
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
    """Write navigation.csv, surfaces, episodes, figure and provenance of all mappers that are finished.

    Args:
        episodes: directory of the files of every mapper, see `navigation.trials`.
        analysis: directory of the analysis of the outputs.

    Returns:
        the rows of navigation.csv, see `compare_mappers`.
    """
    mappers = mappers_of(path.parent.name for path in episodes.glob(f"*/{ORIGIN}"))
    driven = pd.concat([pd.read_csv(episodes / mapper / EPISODES) for mapper in mappers], ignore_index=True)
    found = mapper_results(driven)
    results, surfaces = compare_mappers(found), surfaces_of(found)
    analysis.mkdir(parents=True, exist_ok=True)
    for stem, table in {"": results, "_surfaces": surfaces, "_episodes": driven}.items():
        write_text(analysis / f"navigation{stem}.csv", table.to_csv(index=False, float_format="%.4g"))
    origins = {mapper: read_mapping(episodes / mapper / ORIGIN, "the provenance of a mapper") for mapper in mappers}
    write_json(analysis / "navigation.json", origins)
    _draw(surfaces, analysis / "navigation")
    return results


@dataclass(frozen=True, eq=False)
class MapperResult:
    """What the robots with one mapper reached.

    Args:
        surface: the scores of its settings on the validation courses.
        settings: of the planner and the mapper, chosen with all validation courses.
        test: episodes with them on the test courses.
        shifts: success with the settings of each resample of the validation courses less that with these, on the test
            courses that were driven with both, by experiment and for all, each (draws + 1,).
        covered: share of the resamples whose settings were driven on test courses; the others have no shift.
    """

    surface: Surface
    settings: str
    test: pd.DataFrame
    shifts: Mapping[str, np.ndarray]
    covered: float

    @classmethod
    def of(cls, driven: pd.DataFrame) -> "MapperResult":
        """Choose the settings in each resample, and gather their test results."""
        surface = Surface.of(driven[driven["split"] == "validation"])
        test = driven[driven["split"] == "test"].assign(success=lambda rows: (rows["outcome"] == "goal").astype(float))
        by_course = test.pivot(index=["experiment", "seed"], columns="settings", values="success")
        settings = surface.chosen[0]
        shifts = {name: np.zeros(len(surface.chosen)) for name in (ALL, *test["experiment"].unique())}
        for label in by_course.columns.drop(settings):
            gain = (by_course[label] - by_course[settings]).dropna()
            for name in shifts:
                own = gain.to_numpy() if name == ALL else gain[name].to_numpy()
                drawn = draw_weights(len(own)) @ own / len(own)
                shifts[name] += np.where(surface.chosen == label, drawn, 0.0)
        covered = float(np.isin(surface.chosen[1:], by_course.columns).mean())
        return cls(surface, settings, test[test["settings"] == settings], shifts, covered)


def mapper_results(driven: pd.DataFrame) -> dict[str, MapperResult]:
    """Return what the robots reached, by mapper, from the episodes of all mappers."""
    return {str(mapper): MapperResult.of(own) for mapper, own in driven.groupby("mapper", sort=False)}


def compare_mappers(found: Mapping[str, MapperResult]) -> pd.DataFrame:
    """Return one row per experiment and mapper, and one for all experiments: how well the robots drove.

    Intervals are over the test courses and the choice of the settings. Differences are those to the classical mapper
    that is best on the validation courses, on the test courses that both have; that of the time is over the courses
    where both succeed; those that are `fixed` have no choice in them. The `lead` is that of the network, the best one
    on the validation courses, over each mapper.
    """
    best = _best(found, [mapper for mapper in BEST_OF if mapper in found])
    network = _best(found, [mapper for mapper in found if mapper not in TITLES])
    test = pd.concat([one.test for one in found.values()], ignore_index=True).assign(spl=spl, barn=barn)
    rows = []
    for experiment, of_experiment in [(ALL, test), *test.groupby("experiment", sort=False)]:
        by_mapper = of_experiment.pivot(index=["experiment", "seed"], columns="mapper", values=["success", "time_s"])
        success, time_s = by_mapper["success"], by_mapper["time_s"].where(by_mapper["success"] == 1)
        for mapper in mappers_of(success):
            own, one = of_experiment[of_experiment["mapper"] == mapper], found[mapper]
            row: dict[str, Any] = {"experiment": experiment, "mapper": mapper, "title": title_of(mapper)}
            row |= {"settings": one.settings, "covered": one.covered, "episodes": len(own)}
            row |= _interval("success", "", success[mapper], one.shifts[experiment])
            if best is not None:
                gain, shift = success[mapper] - success[best], one.shifts[experiment] - found[best].shifts[experiment]
                row |= _interval("difference", "difference_fixed_", gain, 0 * shift)
                row |= _interval("difference", "difference_", gain, shift)
                row["time_difference_s"] = float((time_s[mapper] - time_s[best]).mean())
            if network is not None:
                shift = found[network].shifts[experiment] - one.shifts[experiment]
                row |= _interval("lead", "lead_", success[network] - success[mapper], shift)
            rows.append(row | _measures(own))
    return pd.DataFrame(rows)


def _best(found: Mapping[str, MapperResult], mappers: Iterable[str]) -> str | None:
    return max(mappers, key=lambda mapper: found[mapper].surface.scores.max(), default=None)


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


def _interval(name: str, prefix: str, values: pd.Series, shift: np.ndarray) -> dict[str, float]:
    """Return the mean of values and its interval, with shifts of its draws; courses that were not driven have none."""
    known = values.dropna().to_numpy()
    drawn = draw_weights(len(known)) @ known / len(known) + shift
    low, high = bounds(drawn.clip(-1 if prefix else 0, 1))
    return {name: float(drawn[0]), f"{prefix}low": float(low), f"{prefix}high": float(high)}


def surfaces_of(found: Mapping[str, MapperResult]) -> pd.DataFrame:
    """Return the smoothed scores of all settings of each mapper, see `Surface`."""
    rows = []
    for mapper, surface in ((mapper, one.surface) for mapper, one in found.items()):
        counts, shares = surface.driven.sum(0), [(surface.chosen[1:] == label).mean() for label in surface.labels]
        for label, score, count, share in zip(surface.labels, surface.scores, counts, shares, strict=True):
            known = {"mapper": mapper, "settings": label, "episodes": count, "score": score, "chosen": share}
            rows.append(known | settings_of(label))
    return pd.DataFrame(rows)


def _draw(surfaces: pd.DataFrame, stem: Path) -> None:
    """Draw the best smoothed score over the inflation, and over the weight, one line per mapper."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, 2, figsize=(7.2, 4.0), sharey=True, layout="constrained")
        for ax, (name, label) in zip(axes, {"inflation_m": "inflation [m]", "weight": "weight"}.items(), strict=True):
            for number, mapper in enumerate(mappers_of(surfaces["mapper"].unique())):
                line = surfaces[surfaces["mapper"] == mapper].groupby(name)["score"].max()
                look: Any = {"color": COLORS[number % len(COLORS)], "marker": MARKERS[number % 8], "ms": 4, "lw": 1}
                ax.plot(line.index, line, label=title_of(mapper), **look)
            ax.set(xlabel=label)
        axes[1].set_xscale("log")
        axes[0].set_ylabel("smoothed score")
        one_legend(figure, axes, rows=3)
        save(figure, stem)
