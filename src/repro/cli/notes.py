"""What a user should know before a call runs: the scale where it was not chosen, and warnings."""

import sys
from collections.abc import Iterator

from omegaconf import OmegaConf

from repro.cli.call import Call
from repro.parallel import has_gpu
from repro.system.places import conf_directory


def print_notes(calls: list[Call], overrides: list[str]) -> None:
    """Print the scale where it was not chosen, and warnings."""
    scale = calls[0].scale
    if calls[0].facts.names_scale and not any(override.startswith("scale=") for override in overrides):
        why = "a CUDA GPU is visible" if has_gpu() else "no CUDA GPU is visible"
        other = "laptop" if scale.name == "paper" else "paper"
        takes = OmegaConf.load(conf_directory() / "scale" / f"{other}.yaml").takes
        print(f"scale={scale.name} ({why}): {scale.size_px} px, the whole study takes {scale.takes}", flush=True)
        print(f"  the other default, scale={other}, takes {takes}; scale=first takes minutes", flush=True)
    for warning in dict.fromkeys(warning for call in calls for warning in warnings_of(call)):
        print(f"note: {warning}", file=sys.stderr)


def warnings_of(call: Call) -> Iterator[str]:
    """Yield warnings of values that are allowed and may surprise."""
    if call.facts.trains and call.scale.name == "paper" and not has_gpu():
        yield "scale=paper takes days without a GPU, see task=plan; scale=laptop takes an hour or two"
    if not call.experiment["clear_radius_m"]:
        yield f"exp {call.exp} has no clear zone: recording stops where an obstacle reaches the robot"
    is_one_way = call.experiment.get("fixed") or call.experiment["motion"]["name"] == "waypoints"
    if call.facts.trains and call.train.flip_augmentation and is_one_way:
        yield "train.flip_augmentation=true also shows the network the fixed obstacles or the path upside down"
