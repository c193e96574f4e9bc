"""Names of experiments, models and predictors in tables, figures and messages."""

from repro.baselines.titles import BASELINES
from repro.runs.config import NO_DECAY, PROJECTION

TITLES = {
    "unet": "U-Net",
    "fpn": "FPN",
    "upernet": "UPerNet",
    "segformer": "Segformer",
    "convgru": "ConvGRU",
    "convlstm": "ConvLSTM",
    "average": "Average",
    **BASELINES,
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
