"""The comparison of the mappers of task=navigate: tables, and the figure of the scores of the settings."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from repro.metrics.bootstrap import bounds
from repro.navigation.draws import Draws, MapperResult
from repro.navigation.surfaces import settings_of, spl
from repro.navigation.trials import EPISODES, ORIGIN, read_episodes
from repro.reporting.names import predictor_title
from repro.reporting.plots import INK, MARKERS, STYLE, one_legend, save
from repro.system.files import read_mapping, write_json, write_text

BEST = "classical"  # the row of that one of `BEST_OF` which is best on the validation courses
TITLES = {
    "scan": "Current scan",
    "keep": "Hits until a beam passes",
    "decay": "Hits for a time",
    "log_odds": "Log-odds grid",
    "tracker": "Tracker, constant velocity",
    BEST: "Best classical map",
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
    driven = pd.concat([read_episodes(episodes / mapper / EPISODES) for mapper in mappers], ignore_index=True)
    found = mapper_results(driven)
    results, surfaces = compare_mappers(found), surfaces_of(found)
    analysis.mkdir(parents=True, exist_ok=True)
    for stem, table in {"": results, "_surfaces": surfaces, "_episodes": driven}.items():
        write_text(analysis / f"navigation{stem}.csv", table.to_csv(index=False, float_format="%.4g"))
    origins = {mapper: read_mapping(episodes / mapper / ORIGIN, "the provenance of a mapper") for mapper in mappers}
    write_json(analysis / "navigation.json", origins)
    _draw(surfaces, analysis / "navigation")
    return results


def mapper_results(driven: pd.DataFrame) -> dict[str, MapperResult]:
    """Return what the robots reached, by mapper, from the episodes of all mappers."""
    return {str(mapper): MapperResult.of(own) for mapper, own in driven.groupby("mapper", sort=False)}


def compare_mappers(found: Mapping[str, MapperResult]) -> pd.DataFrame:
    """Return one row per experiment and mapper, and one for all experiments: how well the robots drove.

    Intervals are over the test courses and the choice of the settings. A row of its own has the classical mapper that
    is best on the validation courses, which each resample chooses anew. Differences are those to it, on the test
    courses that both have; that of the time is over the courses where both succeed; those that are `fixed` have no
    choice in them. The `lead` is that of the network, the best one on the validation courses, over each mapper.
    """
    test = pd.concat([one.test for one in found.values()], ignore_index=True).assign(spl=spl, barn=barn)
    rows = []
    for experiment, of_experiment in [(ALL, test), *test.groupby("experiment", sort=False)]:
        draws = Draws.of(of_experiment, found)
        networks = [mapper for mapper in map(str, draws.success) if mapper not in TITLES]
        network = networks[_best(found, networks)[0]] if networks else None
        classical = [mapper for mapper in BEST_OF if mapper in draws.success]
        best = _best(found, classical)
        for mapper in mappers_of([*draws.success, *([BEST] if len(classical) > 1 else [])]):
            names, which = (classical, best) if mapper == BEST else ([mapper], 0 * best)
            own, one = of_experiment[of_experiment["mapper"] == names[which[0]]], found[names[which[0]]]
            row: dict[str, Any] = {"experiment": experiment, "mapper": mapper, "title": title_of(mapper)}
            row |= {"settings": one.settings, "covered": one.covered, "episodes": len(own)}
            row |= _interval("success", "", np.choose(which, [draws.level(name) for name in names]))
            if classical and mapper != BEST:
                row |= _interval("difference", "difference_fixed_", draws.gain(mapper, classical[best[0]], fixed=True))
                row |= _interval(
                    "difference", "difference_", np.choose(best, [draws.gain(mapper, name) for name in classical])
                )
                row["time_difference_s"] = draws.later(mapper, classical[best[0]])
            if network:
                row |= _interval("lead", "lead_", np.choose(which, [draws.gain(network, name) for name in names]))
            rows.append(row | _measures(own))
    return pd.DataFrame(rows)


def _best(found: Mapping[str, MapperResult], mappers: Sequence[str]) -> np.ndarray:
    """Return which mapper is best with all validation courses, then in each resample, (draws + 1,)."""
    return np.argmax([found[mapper].surface.scores.max(1) for mapper in mappers] or [[0]], axis=0)


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


def _interval(name: str, prefix: str, drawn: np.ndarray) -> dict[str, float]:
    low, high = bounds(drawn.clip(-1 if prefix else 0, 1))
    return {name: float(drawn[0]), f"{prefix}low": float(low), f"{prefix}high": float(high)}


def surfaces_of(found: Mapping[str, MapperResult]) -> pd.DataFrame:
    """Return the smoothed scores of all settings of each mapper, see `Surface`."""
    rows = []
    for mapper, surface in ((mapper, one.surface) for mapper, one in found.items()):
        counts, shares = surface.driven.sum(0), [(surface.chosen[1:] == label).mean() for label in surface.labels]
        for label, score, count, share in zip(surface.labels, surface.scores[0], counts, shares, strict=True):
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
