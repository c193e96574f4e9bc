"""What the reproduction claims: results copied from an outputs directory into reproduce/results, and into README.

A published directory holds main.csv and ablation.csv, runs.csv (every run with its seed, metrics and times),
provenance.json (where every run came from), the figures, and a README.md that says what was run, on what, and
how to do it again. The tables of the project's README are generated from it and from nothing else.
"""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pandas as pd

from repro.evaluation.metrics import METRICS
from repro.learning.models import load_model
from repro.reporting.paper import KEYS
from repro.reporting.results import TRAINED, caption, read_results
from repro.reporting.tables import NAMES, SETUPS, costs_to_markdown, to_markdown, write_tables
from repro.runs import read_config, read_provenance, read_status, run_directory

MARKS = re.compile(r"(<!-- results: (\w+) (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def publish(outputs: Path, results: Path, scale: str) -> Path:
    """Copies what an outputs directory has measured to the directory of the same name in results.

    Args:
        outputs: the outputs directory of one scale, named after it or after what is special about its runs.
        results: reproduce/results.
        scale: the scale.

    Returns:
        the published directory.

    Raises:
        ValueError: no network has been evaluated there.
    """
    runs = read_results(outputs)
    if runs.empty or not runs["model"].isin(TRAINED).any():
        raise ValueError(f"nothing to publish in {outputs}: no network has been evaluated there")
    target = results / outputs.name
    target.mkdir(parents=True, exist_ok=True)
    for name, page in write_tables(outputs).items():
        if (outputs / "tables" / f"{name}.csv").is_file():
            shutil.copyfile(outputs / "tables" / f"{name}.csv", target / f"{name}.csv")
            note = re.search(r"\*\*(.*?)\*\*", page)
            assert note
            (target / f"{name}.txt").write_text(note[1] + "\n")
    runs.to_csv(target / "runs.csv", index=False, float_format="%.6g")
    origins = {
        str(run.relative_to(outputs)): read_provenance(run)
        for run in (run_directory(outputs, *keys) for keys in runs[[*KEYS, "seed"]].to_numpy())
    }
    (target / "provenance.json").write_text(json.dumps(origins, indent=1) + "\n")
    for figure in sorted((outputs / "figures").glob("*.png")):
        shutil.copyfile(figure, target / figure.name)
    words = f"scale={scale}" + ("" if outputs.name == scale else f" outputs=outputs/{outputs.name}")
    (target / "README.md").write_text(page_of_runs(outputs.name, words, runs, list(origins.values())))
    return target


def page_of_runs(name: str, words: str, runs: pd.DataFrame, origins: list[dict[str, Any]]) -> str:
    """What was run, on what, for how long, and the command (with `words`) that trains each network again."""
    networks = runs[runs["model"].isin(TRAINED)]
    seeds, experiments = (",".join(map(str, sorted(networks[key].unique()))) for key in ("seed", "experiment"))
    machines = sorted({json.dumps(origin["hardware"], sort_keys=True) for origin in origins})
    versions = {name: origins[-1]["versions"][name] for name in ("torch", "segmentation-models-pytorch", "ir-sim")}
    precisions = sorted({origin["precision"] for origin in origins if "precision" in origin})
    words += f" runtime.precision={precisions[0]}" if len(precisions) == 1 else ""
    commits = sorted({str(origin["commit"]) for origin in origins})
    lines = [
        f"# Published results, {name}\n",
        caption(runs, name) + "\n",
        "`main.csv` and `ablation.csv` are the tables, `runs.csv` has every run with its seed, all metrics and times,",
        "`provenance.json` where every run came from.\n",
        f"- machine: {'; '.join(machines)}",
        f"- versions: {', '.join(f'{name} {number}' for name, number in versions.items())}",
        f"- commit: {', '.join(commits)}",
        f"- precision: {', '.join(precisions)}\n",
        "| network | trainings | minutes each | train it again |",
        "|---|---|---|---|",
    ]
    for model in TRAINED:
        mine = networks[networks["model"] == model]
        if len(mine):
            command = f"python run.py -m model={model} exp={experiments} seed={seeds} {words}"
            minutes = mine["training_seconds"].mean() / 60
            lines.append(f"| {NAMES[model]} | {len(mine)} | {minutes:.1f} | `{command}` |")
    if not runs["decay"].all():
        lines.append("\nThe ablation: `exp=3,4 decay=false` in place of `exp=...`.")
    return "\n".join(lines) + "\n"


def export_weights(run: Path, target: Path) -> None:
    """Writes the best weights of a run as float16, with a card that says what they are and are not.

    Args:
        run: an evaluated run directory.
        target: a directory from which `smp.from_pretrained` reads them.

    Raises:
        ValueError: the run is not evaluated.
    """
    if read_status(run) != "evaluated":
        raise ValueError(f"{run} is not evaluated, so there is nothing to say of its weights")
    load_model(run / "model").half().save_pretrained(target)
    where = "/".join(target.parts[-2:])
    (target / "README.md").write_text(_card(run, where, read_config(run), read_provenance(run)))


def _card(run: Path, where: str, config: dict[str, Any], origin: dict[str, Any]) -> str:
    """The model card: data, metrics, limits."""
    metrics, data, model = pd.read_csv(run / "metrics.csv").iloc[0], config["data"], config["model"]
    law = f"lightest={data['lightest']}" if config["decay"] else "decay=False"
    numbers = ", ".join(f"{metric} {metrics[metric]:.4f}" for metric in (*METRICS, "obstacle_iou"))
    return f"""# {NAMES[model["name"]]} ({model["encoder_name"]}), experiment {config["experiment"]}

```python
import segmentation_models_pytorch as smp
import torch

from repro.maps.grid import Grid
from repro.maps.projection import project

model = smp.from_pretrained("reproduce/results/{where}").float().eval()
with torch.inference_mode():
    image = project(ranges, angles, poses, Grid({data["size_px"]}), {law})  # uint8, (B, H, W)
    free = model(image[:, None] / 255).sigmoid()  # probability of free at the last step, (B, 1, H, W)
```

**Input**: lidar ranges [m] (B, T, N), inf for a miss; beam angles [rad] (N,); poses x, y [m], heading [rad] (B, T, 3)
in a map of 50 x 50 m, as float32 tensors. The image holds them all: the cumulative dynamic sensor projection.
**Output**: the map at the last step, row 0 at the top; below 0.5 is an obstacle.

**Data**: {origin["train_pairs"]} simulated pairs ({SETUPS[config["experiment"]]}),
recordings {origin["recordings"][:12]}, seed {config["seed"]}, {origin["epochs"]} epochs, commit {origin["commit"]}.

**Test set** ({origin["test_pairs"]} pairs): {numbers}.

**Limits**: scans without noise, obstacles of the sizes and speeds of `conf/world/paper.yaml`, one robot path,
float16 weights. It has seen nothing but simulation.
"""


def readme_with_results(text: str, results: Path) -> str:
    """The README with the tables between its marks made anew from the published results.

    A mark is `<!-- results: laptop main -->`, closed by `<!-- end -->`. In place of `main` it may name another table
    (`ablation`, `costs`), or one network or `average` for its rows of both tables.
    """

    def table(match: re.Match[str]) -> str:
        directory, name = results / match[2], match[3]
        if name in NAMES:
            page = to_markdown(*_rows_of_model(directory, name))
        else:
            page = (costs_to_markdown if name == "costs" else to_markdown)(*_published(directory, name))
        return match[1] + page + match[4]

    return MARKS.sub(table, text)


def _published(directory: Path, name: str) -> tuple[pd.DataFrame, str]:
    """A published table and its caption."""
    rows = pd.read_csv(directory / f"{name}.csv", dtype={"experiment": str})
    return rows, (directory / f"{name}.txt").read_text().strip()


def _rows_of_model(directory: Path, model: str) -> tuple[pd.DataFrame, str]:
    """The rows of one model, or of the average, in the main table and the ablation, with a caption."""
    (main, note), (ablation, _) = (_published(directory, name) for name in ("main", "ablation"))
    ablation["experiment"] += ", no decay"
    rows = pd.concat([main, ablation]).query("model == @model")
    return rows, note[note.index("Scale ") :]
