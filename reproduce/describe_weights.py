r"""Add to published weights what the description of a network holds today: statistics of the training scans, metadata.

python run.py task=record exp=4 scale=workstation
python reproduce/describe_weights.py reproduce/results/workstation runs/exp4/unet/projection/seed0 \
    outputs/workstation/recordings/exp4

The recordings must be those of the training, of which the provenance holds the checksum. The weights stay as they are.
"""

import json
import sys
from pathlib import Path

import pandas as pd

from repro.config import NETWORKS
from repro.maps.datasets import STATISTICS_PAIRS
from repro.maps.statistics import summarize
from repro.networks.predictor import describe, load_predictor
from repro.recordings.reader import read_manifest, read_shards, recordings_hash
from repro.reporting.export import CARD_METRICS, with_front_matter
from repro.reporting.names import SETUPS
from repro.system.files import write_text


def main(results: Path, key: str, recordings: Path) -> None:
    """Rewrite predictor.json and README.md of the exported weights of a published run.

    Args:
        results: published directory.
        key: the run, as in its provenance.json.
        recordings: recordings of its experiment.
    """
    _, experiment, model, encoding, seed = key.split("/")
    directory = results / f"{experiment}-{model}"
    steps = json.loads((results / "provenance.json").read_text(encoding="utf-8"))[key]["steps"]
    expected = next(step["recordings"] for step in steps if "recordings" in step)
    if recordings_hash(recordings) != expected:
        sys.exit(f"{recordings} has the checksum {recordings_hash(recordings)}, the training had {expected}")
    grid = load_predictor(directory).grid
    count = min(read_manifest(recordings).pairs["train"], STATISTICS_PAIRS)
    describe(directory, summarize((s.scans.tensors() for s in read_shards(recordings, "train", count)), grid))

    runs = pd.read_csv(results / "runs.csv").astype({"experiment": str})
    is_run = (
        (runs["experiment"] == experiment.removeprefix("exp"))
        & (runs["model"] == model)
        & (runs["encoding"] == encoding)
        & (runs["seed"] == int(seed.removeprefix("seed")))
    )
    (row,) = runs[is_run].to_dict("records")
    body = "# " + (directory / "README.md").read_text(encoding="utf-8").split("# ", 1)[1]
    title = body.splitlines()[0].removeprefix("# ")
    setup = SETUPS[experiment.removeprefix("exp")]
    library = "segmentation-models-pytorch" if model in NETWORKS else "pytorch"
    card = with_front_matter(body, title, setup, {name: float(row[name]) for name in CARD_METRICS}, library)
    write_text(directory / "README.md", card)
    load_predictor(directory)


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]))
