"""Whether runs came out as the published ones did: the same recordings, the same weights, the same numbers."""

from pathlib import Path

import pandas as pd

from repro.metrics.names import METRICS
from repro.reporting.names import predictor_title
from repro.reporting.results import SIZES, read_published, read_results
from repro.reporting.rows import keys_of
from repro.runs.directories import Outputs
from repro.runs.keys import KEY, RunKey
from repro.runs.provenance import Provenance
from repro.system.files import read_typed

COMPARED = (*METRICS, "obstacle_iou")
SHOWN = {"accuracy": "Acc.", "specificity": "Spec.", "obstacle_iou": "Obstacle IoU"}


def verify(outputs: Outputs, published: Path) -> pd.DataFrame:
    """Compares every evaluated run with the published run of the same experiment, model, input and seed.

    Args:
        outputs: an outputs directory.
        published: a directory that `publish.publish` wrote.

    Returns:
        one row a run that both have: experiment, model, encoding, seed; recordings and weights, `same` or
        `other` by their checksums (weights empty where nothing is learned); commit and published_commit of the
        training; every metric as <metric>, published_<metric> and delta_<metric>.

    Raises:
        ValueError: nothing is published there, no run is in both, or they are of different resolutions or pairs.
    """
    theirs, ours = read_published(published), read_results(outputs)
    both = ours.merge(theirs, on=KEY, suffixes=("", "_published")) if len(ours) else ours
    if both.empty:
        raise ValueError(f"none of the {len(theirs)} runs in {published} has been evaluated in {outputs.path}")
    for size, word in SIZES.items():
        here, there = both[size].dropna(), both[f"{size}_published"].dropna()
        if set(here) != set(there):
            raise ValueError(f"published are {there.max():.0f} {word}, in {outputs.path} are {here.max():.0f}")
    origins = read_typed(dict[str, Provenance], published / "provenance.json", "git has it")
    rows = zip(keys_of(both), both.to_dict("records"), strict=True)
    return pd.DataFrame([_compare(outputs, key, row, origins) for key, row in rows])


def _compare(outputs: Outputs, key: RunKey, row: dict, origins: dict[str, Provenance]) -> dict[str, object]:
    own, theirs = outputs.run(key).provenance(), origins[str(key.path)]
    compared: dict[str, object] = {name: row[name] for name in KEY}
    for name, fact in (("recordings", "recordings"), ("weights", "weights_sha256")):
        known = own.fact(fact) is not None
        compared[name] = ("same" if own.fact(fact) == theirs.fact(fact) else "other") if known else ""
    compared |= {"commit": _commit(own), "published_commit": _commit(theirs)}
    for metric in COMPARED:
        here, there = round(row[metric], 6), round(row[f"{metric}_published"], 6)
        compared |= {metric: here, f"published_{metric}": there, f"delta_{metric}": here - there}
    return compared


def _commit(origin: Provenance) -> object:
    steps = [step for step in origin.steps if step["step"] == "trained"] or origin.steps
    return steps[-1].get("commit")


def verification_to_markdown(compared: pd.DataFrame) -> str:
    """Writes what `verify` found: one row a run, ours (published), then what it comes to."""
    lines = ["| Exp. | Model | Seed | Recordings | Weights | " + " | ".join(SHOWN.values()) + " |"]
    lines.append("|---" * (5 + len(SHOWN)) + "|")
    for _, row in compared.iterrows():
        title = predictor_title(row["model"], row["encoding"])
        numbers = " | ".join(f"{row[metric]:.4f} ({row[f'published_{metric}']:.4f})" for metric in SHOWN)
        facts = f"{'' if pd.isna(row['seed']) else row['seed']} | {row['recordings']} | {row['weights']}"
        lines.append(f"| {row['experiment']} | {title} | {facts} | {numbers} |")
    trained = compared[compared["weights"] != ""]
    recorded, weighed = ((rows == "same").sum() for rows in (compared["recordings"], trained["weights"]))
    apart = ", ".join(f"{word} {compared[f'delta_{metric}'].abs().max():.4f}" for metric, word in SHOWN.items())
    lines += [
        "",
        f"Ours (published). Of {len(compared)} runs {recorded} have the recordings that were published, of "
        f"{len(trained)} trainings {weighed} the same weights, byte for byte. Largest difference: {apart}.",
    ]
    return "\n".join(lines)
