"""Verification: comparison of runs with the published ones, by recordings, weights and metrics."""

from pathlib import Path

import pandas as pd

from repro.metrics.names import SUMMARY
from repro.reporting.names import predictor_title
from repro.reporting.render import Cells
from repro.reporting.results import SIZES, read_origins, read_published, read_results
from repro.reporting.rows import MEASURED, keys_of
from repro.runs.keys import KEY, RunKey
from repro.runs.outputs import Outputs
from repro.runs.provenance import Provenance
from repro.system.errors import InputError


def verify(outputs: Outputs, published: Path) -> pd.DataFrame:
    """Compare every evaluated run with the published run of the same experiment, model, input and seed.

    Args:
        outputs: an outputs directory.
        published: a directory that `publish.publish` wrote.

    Returns:
        one row per run in both: experiment, model, encoding, seed; recordings and weights, `same` or `other` by their
        checksums (weights are empty for baselines); commit and published_commit of the training; every metric as
        <metric>, published_<metric> and delta_<metric>.

    Raises:
        ValueError: no results are published, no run is in both, or resolutions or numbers of pairs differ.
    """
    published_runs, ours = read_published(published), read_results(outputs)
    both = ours.merge(published_runs, on=KEY, suffixes=("", "_published")) if len(ours) else ours
    if both.empty:
        raise InputError(f"none of the {len(published_runs)} runs in {published} is evaluated in {outputs.path}")
    for size, unit in SIZES.items():
        own, other = both[size].dropna(), both[f"{size}_published"].dropna()
        if set(own) != set(other):
            raise InputError(
                f"the published runs have {other.max():.0f} {unit}, the runs in {outputs.path} have {own.max():.0f}"
            )
    origins = read_origins(published, keys_of(both))
    rows = zip(keys_of(both), both.to_dict("records"), strict=True)
    compared = pd.DataFrame([_compare(outputs, key, row, origins) for key, row in rows])
    return compared.astype({"seed": "Int64"})  # baselines have no seed


def _compare(outputs: Outputs, key: RunKey, row: dict, origins: dict[str, Provenance]) -> dict[str, object]:
    own, other = outputs.run(key).provenance(), origins[str(key.path)]
    compared: dict[str, object] = {name: row[name] for name in KEY}
    for name, fact in (("recordings", "recordings"), ("weights", "weights_sha256")):
        is_known = own.fact(fact) is not None
        compared[name] = ("same" if own.fact(fact) == other.fact(fact) else "other") if is_known else ""
    compared |= {"commit": _commit(own), "published_commit": _commit(other)}
    for metric in MEASURED:
        value, published = round(row[metric], 6), round(row[f"{metric}_published"], 6)
        compared |= {metric: value, f"published_{metric}": published, f"delta_{metric}": value - published}
    return compared


def _commit(origin: Provenance) -> object:
    return (origin.last("trained") or origin.steps[-1]).get("commit")


def verification_to_markdown(compared: pd.DataFrame) -> str:
    """Return the comparison of `verify` as Markdown: one row per run, ours (published), and a summary."""
    rows = []
    for _, row in compared.iterrows():
        seed = "" if pd.isna(row["seed"]) else row["seed"]
        numbers = [f"{row[metric]:.4f} ({row[f'published_{metric}']:.4f})" for metric in SUMMARY]
        title = predictor_title(row["model"], row["encoding"])
        rows.append((row["experiment"], title, seed, row["recordings"], row["weights"], *numbers))
    trained = compared[compared["weights"] != ""]
    same_recordings, same_weights = ((rows == "same").sum() for rows in (compared["recordings"], trained["weights"]))
    largest = ", ".join(f"{head} {compared[f'delta_{metric}'].abs().max():.4f}" for metric, head in SUMMARY.items())
    table = Cells(("Exp.", "Model", "Seed", "Recordings", "Weights", *SUMMARY.values()), rows)
    return (
        f"{table.to_markdown()}\n"
        f"Ours (published). {same_recordings} of {len(compared)} runs use the published recordings; "
        f"{same_weights} of {len(trained)} trainings have byte-identical weights. Largest difference: {largest}."
    )
