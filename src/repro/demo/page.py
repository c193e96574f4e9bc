"""The browser demo: one self-contained HTML file that runs networks in worlds of the study.

The page consists of `assets/`: ES modules without a build step, which are joined into one script of the page and one of
its worker. ONNX Runtime Web and the networks are embedded as base64 of gzip.
"""

import base64
import gzip
import re
from collections.abc import Mapping
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps

from repro.demo.networks import DemoNetwork
from repro.demo.runtime import VERSION, Runtime
from repro.recordings.format import SHOWN_SEED
from repro.simulation.sampling import World, sample_world
from repro.simulation.simulator import drive_robot, move_obstacles, outlines_of_world
from repro.system.errors import InputError
from repro.worlds.spec import WorldSpec

ASSETS = Path(str(files("repro.demo"))) / "assets"
PAGE, WORKER = ("world.js", "drawing.js", "main.js"), ("visibility.js", "encodings.js", "worker.js")
WORLDS, WINDOWS = 3, 6  # of each experiment, and the length of a world


def render(networks: list[DemoNetwork], runtime: Runtime, specs: Mapping[str, WorldSpec]) -> str:
    """Return the page.

    Args:
        networks: the networks to choose from; the first is selected.
        runtime: ONNX Runtime Web.
        specs: what decides the worlds of each experiment, by its name.

    Raises:
        InputError: the page cannot show the worlds, or a network was trained for other maps or windows.
    """
    for name, each in specs.items():
        if not each.is_like_papers:
            raise InputError(f"the demo cannot show experiment {name}, with {each.motion.name}: use world=paper")
    spec, steps = next(iter(specs.values())), networks[0].predictor.steps
    for network in networks:
        _check_network(network, spec, steps)
    lidar, longest = spec.lidar.irsim(), WINDOWS * steps
    settings = {
        "worlds": {name: [_shown(each, seed, longest) for seed in range(WORLDS)] for name, each in specs.items()},
        "lidar": lidar,
        **{"sizeM": spec.world.width, "stepMs": 1000 * spec.world.step_time, "steps": steps, "longest": longest - 1},
        "networks": [_described(network) for network in networks],
        **{"runtime": runtime.script, "wasm": _pack(runtime.wasm), "worker": joined(*WORKER)},
    }
    environment = Environment(loader=PackageLoader("repro.demo", "assets"), autoescape=True, undefined=StrictUndefined)
    return environment.get_template("index.html").render(
        style=(ASSETS / "style.css").read_text(encoding="utf-8"),
        script=joined(*PAGE),
        settings=htmlsafe_json_dumps(settings),
        networks=networks,
        experiments={name: _title(name, each) for name, each in specs.items()},
        lidar=lidar,
        steps=steps,
        seconds=f"{steps * spec.world.step_time:g}",
        runtime=VERSION,
    )


def describe_world(world: World, steps: int) -> dict[str, Any]:
    """Return the robot and the obstacles of a world over some steps, as assets/world.js takes them."""
    states = move_obstacles(world, steps)
    moves = (states != states[:, :1]).any()
    return {
        "poses": drive_robot(world).round(6).tolist(),
        "outlines": [outline.ravel().tolist() for outline in outlines_of_world(world).round(4)],
        "headings": states[:, 0, 2].round(6).tolist(),
        "paths": [path.ravel().tolist() for path in states[:, : None if moves else 1, :2].round(4)],
    }


def joined(*names: str) -> str:
    """Join JavaScript modules, each after those that it imports, into one script."""
    sources = [(ASSETS / name).read_text(encoding="utf-8") for name in names]
    return "".join(re.sub(r"^(import .*\n|export )", "", source, flags=re.MULTILINE) for source in sources)


def _shown(spec: WorldSpec, seed: int, steps: int) -> dict[str, Any]:
    return describe_world(sample_world(spec, SHOWN_SEED + seed), steps)


def _described(network: DemoNetwork) -> dict[str, Any]:
    encoding = {"name": network.predictor.encoding.name, "parameters": vars(network.predictor.encoding)}
    return {"encoding": encoding, "grid": asdict(network.predictor.grid), "weights": _pack(network.onnx)}


def _check_network(network: DemoNetwork, spec: WorldSpec, steps: int) -> None:
    """Check that a network predicts maps of the worlds, from windows of the page."""
    predictor = network.predictor
    found, expected = (
        f"maps of {size_m:g} m from {count} steps of {step_s:g} s"
        for size_m, count, step_s in (
            (predictor.grid.size_m, predictor.steps, predictor.step_s),
            (spec.world.width, steps, spec.world.step_time),
        )
    )
    if found != expected:
        raise InputError(f"demo.networks: {network.title} predicts {found}, this page needs {expected}")


def _title(name: str, spec: WorldSpec) -> str:
    moves = "rotates" if spec.motion.name == "rotate" else "drives"
    return f"{name}: {'moving' if spec.behaviors else 'static'}, robot {moves}"


def _pack(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()
