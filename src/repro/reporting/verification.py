"""Whether runs came out as the published ones did: the same recordings, the same weights, the same numbers."""

from pathlib import Path

import pandas as pd

from repro.config import variant
from repro.evaluation.metrics import METRICS
from repro.files import read_typed
from repro.names import predictor_title
from repro.provenance import Provenance
from repro.reporting.results import RUN_KEYS, SIZES, read_published, read_results
from repro.runs import Outputs

COMPARED = (*METRICS, "obstacle_iou")
SHOWN = {"accuracy": "Acc.", "specificity": "Spec.", "obstacle_iou": "Obstacle IoU"}


def verify(outputs: Outputs, published: Path) -> pd.DataFrame:
    """Compares every evaluated run with the published run of the same experiment, model, input and seed.

    Args:
        outputs: an outputs directory.
        published: a directory that `publish.publish` wrote.

    Returns:
        one row a run that both have: experiment, model, encoding, decay, seed; recordings and weights, `same` or
        `other` by their checksums (weights empty where nothing is learned); commit and published_commit of the
        training; every metric as <metric>, published_<metric> and delta_<metric>.

    Raises:
        ValueError: nothing is published there, no run is in both, or they are of different resolutions or pairs.
    """
    theirs, ours = read_published(published), read_results(outputs)
    both = ours.merge(theirs, on=[*RUN_KEYS], suffixes=("", "_published")) if len(ours) else ours
    if both.empty:
        raise ValueError(f"none of the {len(theirs)} runs in {published} has been evaluated in {outputs.path}")
    for size, word in SIZES.items():
        here, there = both[size].dropna(), both[f"{size}_published"].dropna()
        if set(here) != set(there):
            raise ValueError(f"published are {there.max():.0f} {word}, in {outputs.path} are {here.max():.0f}")
    origins = read_typed(dict[str, Provenance], published / "provenance.json", "git has it")
    return pd.DataFrame([_compare(outputs, row, origins) for _, row in both.iterrows()])


def _compare(outputs: Outputs, row: pd.Series, origins: dict[str, Provenance]) -> dict[str, object]:
    run = outputs.run(row["experiment"], row["model"], variant(row["encoding"], row["decay"]), row["seed"])
    own, theirs = run.provenance(), origins[str(run.path.relative_to(outputs.path))]
    compared: dict[str, object] = {key: row[key] for key in RUN_KEYS}
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
        title = predictor_title(row["model"], row["encoding"]) + ("" if row["decay"] else ", no decay")
        numbers = " | ".join(f"{row[metric]:.4f} ({row[f'published_{metric}']:.4f})" for metric in SHOWN)
        facts = f"{row['seed']} | {row['recordings']} | {row['weights']}"
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
