"""Export of a trained network: its weights, or an ONNX file, with a model card for the Hugging Face Hub."""

from pathlib import Path
from typing import Any

import torch
from huggingface_hub import EvalResult, ModelCardData

from repro.learning.networks.torch_files import CARD, OWN_FILES
from repro.learning.networks.trained import export_onnx, load_trained, save_trained
from repro.metrics.headings import METRICS
from repro.networks.predictor import Predictor
from repro.networks.weights import ONNX
from repro.reporting.names import SETUPS, model_title
from repro.reporting.paper import are_papers, world_files
from repro.runs.config import RunConfig
from repro.runs.directories import Run
from repro.system.errors import InputError
from repro.system.files import clear_leftovers, lock, replacing_directory, write_text

CARD_METRICS = (*METRICS, "obstacle_iou")


def export_weights(run: Run, target: Path, *, force: bool = False) -> None:
    """Write the best weights of a run as float16, with a model card.

    Args:
        run: an evaluated run directory.
        target: the directory of the weights; `load_trained` and `smp.from_pretrained` read it.
        force: whether to replace existing weights.

    Raises:
        InputError: the run is not evaluated, or the directory has other files, or weights that are not to be replaced.
    """
    predictor = _evaluated_predictor(run)
    if (target / "predictor.json").is_file() and not force:
        raise InputError(f"{target} has weights already: publish.force=true replaces them")
    target.parent.mkdir(parents=True, exist_ok=True)
    # the lock is that of publishing, which moves the parent
    with lock(target.parents[1]), replacing_directory(target, OWN_FILES.__contains__) as new:
        clear_leftovers(target.parent, keep=new)
        save_trained(predictor, new, torch.float16)
        where = f"reproduce/results/{'/'.join(target.parts[-2:])}"
        write_text(new / CARD, make_card(run, where, "float16 weights"))


def export_run(run: Run, target: Path) -> float:
    """Write the best weights of a run as an ONNX file, model.onnx in float32, with a model card beside and in it.

    Args:
        run: an evaluated run directory.
        target: the directory to create or replace; `networks.predictor.load_predictor` reads it.

    Returns:
        the largest difference of a probability from that of torch.

    Raises:
        InputError: the run is not evaluated, or ONNX Runtime gives other maps than torch.
    """
    predictor = _evaluated_predictor(run)
    card = make_card(run, str(target / ONNX), "float32 weights in ONNX; the batch is dynamic")
    target.parent.mkdir(parents=True, exist_ok=True)
    with lock(target.parent), replacing_directory(target, (ONNX, CARD).__contains__) as new:
        clear_leftovers(target.parent, keep=new)
        difference = export_onnx(predictor, new / ONNX, card)
        write_text(new / CARD, card)
    return difference


def _evaluated_predictor(run: Run) -> Predictor:
    if not run.is_evaluated:
        raise InputError(
            f"{run} is not evaluated: the model card needs its metrics, evaluate it with task=evaluate first"
        )
    return load_trained(run.model)


def _loading(path: str) -> tuple[str, str, str]:
    """Return the further import and the function that load a network, and what defines its encoding and grid."""
    if path.endswith(ONNX):
        return "", "repro.load_predictor", "The metadata of the file define"
    return "\nfrom repro.learning.networks.trained import load_trained", "load_trained", "`predictor.json` defines"


def make_card(run: Run, path: str, form: str) -> str:
    """Return the model card: metadata of the Hugging Face Hub, use, input, output, data, metrics, limits.

    Args:
        run: an evaluated run directory.
        path: what is loaded in the example.
        form: form of the weights.
    """
    config, origin, metrics = run.config(), run.provenance(), run.read_metrics()
    trained = origin.last("trained")
    assert config.encoding, "a network has an encoding"
    assert trained, "an evaluated network is trained"
    measured = {name: float(metrics[name]) for name in CARD_METRICS}
    setup, source = _worlds_of(config)
    encoder = f" ({config.model.encoder_name})" if config.model.encoder_name else ""
    title = f"{model_title(config.model.name)}{encoder}, experiment {config.experiment}"
    parameters = ", ".join(f"{name} {value}" for name, value in config.encoding.parameters.items())
    imports, loader, description = _loading(path)
    library = "segmentation-models-pytorch" if encoder else "pytorch"
    return f"""---
{hub_metadata(title, setup, measured, library)}
---

# {title}

```python
import repro{imports}

predictor = {loader}("{path}")
free = predictor.predict(repro.Scans(ranges, angles, poses))  # probability of free at the last step, (B, H, W)
```

**Input**: lidar ranges [m] (B, T, N), inf for a miss; beam angles [rad] (N,); poses x, y [m], heading [rad] (B, T, 3)
in a map of {config.data.size_m:g} x {config.data.size_m:g} m with its origin at the lower left; NumPy \
arrays. {description} the encoding
({config.encoding.name}: {parameters}) and the grid ({config.data.size_px} px).
**Output**: the map at the last step, row 0 at the top; a pixel below 0.5 is an obstacle.

**Data**: {origin.fact("train_pairs")} simulated pairs ({setup}),
recordings {origin.fact("recordings")[:12]}, seed {config.seed}, {origin.fact("epochs")} epochs,
commit {trained["commit"]}.

**Test set** ({origin.fact("test_pairs")} pairs): {", ".join(f"{name} {each:.4f}" for name, each in measured.items())}.

**Limits**: trained on simulated scans of {source}; {form}.
"""


def _worlds_of(config: RunConfig) -> tuple[str, str]:
    """Return the setup of the experiment of a run, and the worlds of its scans with their limits, in words."""
    names = world_files({config.data.worlds})
    source = f"conf/world/{names[0]}.yaml" if names else "worlds of no file in conf/world"
    if config.experiment in SETUPS and are_papers(config.data.worlds):
        return SETUPS[config.experiment], f"{source}, without noise, with its obstacles and speeds and one robot path"
    return f"experiment {config.experiment} of {source}", source


def hub_metadata(title: str, dataset: str, metrics: dict[str, float], library: str) -> str:
    """Return the metadata of a model card for the Hugging Face Hub as YAML, from names and metrics on the test set."""
    task: dict[str, Any] = {"task_type": "image-segmentation", "dataset_type": "simulated", "dataset_name": dataset}
    results = [
        EvalResult(**task, dataset_split="test", metric_type=name, metric_value=round(value, 4))
        for name, value in metrics.items()
    ]
    data = ModelCardData(
        license="mit",
        library_name=library,
        pipeline_tag="image-segmentation",
        tags=["robotics", "lidar", "occupancy-grid"],
        metrics=list(metrics),
        model_name=title,
        eval_results=results,
    )
    return data.to_yaml()
