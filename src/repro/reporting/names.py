"""Names of experiments, models, predictors, machines and commits, and durations, in tables, figures and messages."""

from repro.baselines.names import BASELINES, OTHER_BOUNDS
from repro.config import NO_DECAY, PROJECTION

TITLES = {
    "unet": "U-Net",
    "fpn": "FPN",
    "upernet": "UPerNet",
    "segformer": "Segformer",
    "convgru": "ConvGRU",
    "convlstm": "ConvLSTM",
    "average": "Average",
    **BASELINES,
    **OTHER_BOUNDS,
}
SETUPS = {"1": "Static, rotation", "2": "Static, square", "3": "Dynamic, rotation", "4": "Dynamic, square"}


def experiment_title(experiment: str, form: str) -> str:
    """Return the title of an experiment; for the paper's experiments the setup follows, formatted by `form`."""
    setup = SETUPS.get(experiment)
    return f"Experiment {experiment}" + (form.format(setup) if setup else "")


def model_title(model: str) -> str:
    """Return the title of a model in `TITLES`, or its name."""
    return TITLES.get(model, model)


def predictor_title(model: str, encoding: str) -> str:
    """Return the title of a model, followed by its encoding unless it is the paper's."""
    base = encoding.removesuffix(NO_DECAY)
    named = "" if base in ("", PROJECTION) else f", {base}"
    return model_title(model) + named + (", no decay" if encoding.endswith(NO_DECAY) else "")


def machine_title(
    gpu: str | None, cpu: str | None = None, cpu_cores: int = 0, threads: int | None = None, machine: str = ""
) -> str:
    """Describe the hardware of a step, see `devices.hardware`; the oldest steps have no name of the CPU."""
    used = "" if threads is None else f", {threads} thread{'' if threads == 1 else 's'}"
    return gpu or f"{cpu or f'CPU ({machine})'}, {cpu_cores} cores{used}"


def short_commit(commit: str | None) -> str:
    """Shorten a commit to ten digits; a plus stands for uncommitted changes."""
    text = str(commit)
    return text[:10] + ("+" if text.endswith("+") else "")


def duration(seconds: float) -> str:
    """Format a duration in seconds, minutes or hours."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.0f} h"
