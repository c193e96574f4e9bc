"""What experiments and predictors are called in tables, figures and messages."""

NAMES = {
    "unet": "U-Net",
    "fpn": "FPN",
    "upernet": "UPerNet",
    "segformer": "Segformer",
    "convlstm": "ConvLSTM",
    "average": "Average",
    "ours": "U-Net, stack10 (ours)",
    "all_free": "All free",
    "last_seen": "Last seen",
    "occupancy": "Occupancy grid",
    "transitional": "Transitional grid",
    "tracker": "Tracker",
}
SETUPS = {"1": "Static, rotation", "2": "Static, square", "3": "Dynamic, rotation", "4": "Dynamic, square"}


def experiment_title(experiment: str, form: str) -> str:
    """Names an experiment; one of the paper's with its set-up in `form`."""
    setup = SETUPS.get(experiment)
    return f"Experiment {experiment}" + (form.format(setup) if setup else "")


def predictor_title(model: str, encoding: str) -> str:
    """Names a network with what it is fed, or a rival; the paper's own input goes without saying."""
    return NAMES.get(model, model) + ("" if encoding == "projection" else f", {encoding}")
