"""What is wrong with the overrides of a call, as far as it shows without composing the configuration."""

import shutil

from hydra.core.override_parser.types import ChoiceSweep, Override, QuotedString

GROUPS = ("world", "encoding", "model", "scale", "train")
TEXTS = (  # keys whose values are names and paths
    *("exp", "outputs", "recordings", "scans", "floor_map", "demo.runtime"),
    *("prediction.weights", "prediction.scan_topic", "prediction.odometry_topic"),
)

OF_A_RUN = ("model", "encoding", "decay", "oldest_gray", "seed", "train")  # keys that choose a network of the study
TASKS = {  # of keys that only some tasks use
    "prediction": ("predict",),
    "demo": ("demo",),
    "publish": ("publish", "export"),
    "format": ("export",),
}
UNUSED = {  # by task: keys without effect, and the key that chooses its networks
    "predict": (("world", "exp", *OF_A_RUN), "prediction.weights"),
    "demo": (OF_A_RUN, "demo.networks"),
}


def unused_errors(overrides: list[str], task: str) -> list[str]:
    """Return which overrides have no effect, as they are for other tasks or choose a network where another key does."""
    keys, chooses = UNUSED.get(task, ((), ""))
    reasons = {key: f"has no effect with task={task}, {chooses} chooses the network" for key in keys}
    for key, tasks in TASKS.items():
        if task not in tasks:
            reasons[key] = f"is for task={' and task='.join(tasks)} only"
    found = [(each, each.lstrip("+~").partition("=")[0].split(".")[0]) for each in overrides]
    return [f"{each}: {reasons[key]}" for each, key in found if key in reasons]


def override_errors(override: Override, multirun: bool) -> list[str]:
    """Return what is wrong with an override."""
    key, written = override.key_or_group, override.input_line or ""
    if not key:
        return [f"{written}: an override is key=value"]
    if override.is_delete() and "." not in key:
        return [f"{written}: {key} cannot be left out"]
    if override.is_sweep_override() and not multirun:
        return [f"{written}: takes one value; for a sweep, add -m"]
    if key == "hydra/launcher" and "slurm" in written and not shutil.which("srun"):
        return [f"{written}: no Slurm on this machine: srun is not found"]
    if key == "hydra.launcher.n_jobs" and not _is_number_of_jobs(override.value()):
        return [f"{written}: expected the number of trainings at the same time, 1 or more, or -1 for that of the cores"]
    if key in TEXTS or key in GROUPS:
        changed = _changed_texts(override, written.partition("=")[2])
        if changed:
            return [f"{written}: Hydra reads this as {', '.join(changed)}; for a name, quote it: '{key}=\"...\"'"]
    return _group_errors(override, written) if key in GROUPS and not override.is_sweep_override() else []


def _is_number_of_jobs(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and (value >= 1 or value == -1)


def _group_errors(override: Override, written: str) -> list[str]:
    """Return what is wrong with the choice of a file in conf/."""
    if isinstance(override.value(), bool | int | float):
        return [f"{written}: Hydra reads this as a number; for a name, quote it: '{override.key_or_group}=\"...\"'"]
    if not isinstance(override.value(), str | QuotedString):
        return [f"{written}: takes one name; for a sweep over several, use -m {override.key_or_group}=a,b"]
    if override.is_add():
        return [f"{written}: {override.key_or_group} is set already; write it without +"]
    return []


def _changed_texts(override: Override, written: str) -> list[str]:
    """Return the values that differ from what was written because Hydra takes them for numbers, such as 10 from 1_0."""
    value = override.value()
    values = value.list if isinstance(value, ChoiceSweep) else [value]
    numbers = [str(each) for each in values if isinstance(each, bool | int | float)]
    return [number for number in numbers if number not in written.split(",")]
