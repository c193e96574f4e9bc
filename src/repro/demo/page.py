"""The browser demo: one self-contained HTML file that runs networks in a world that the user changes.

The page consists of `assets/`: ES modules without a build step, which `loader.js` links in the browser. ONNX Runtime
Web and the networks are embedded as base64 of gzip.
"""

import base64
import gzip
import re
from dataclasses import asdict
from graphlib import TopologicalSorter
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps

from repro.demo.networks import DemoNetwork
from repro.demo.runtime import VERSION, Runtime
from repro.system.errors import InputError
from repro.world_config import is_moving

ASSETS = Path(str(files("repro.demo"))) / "assets"
RUNTIME_MODULE = "ort.mjs"
IMPORTS = re.compile(r'from "\./([\w.]+)"')
MAX_BYTES = 25_000_000
MOTIONS = {"square": "Square", "rotate": "Rotation in place"}


def render(networks: list[DemoNetwork], runtime: Runtime, spec: dict[str, Any]) -> str:
    """Return the page.

    Args:
        networks: the networks to choose from; the first is selected.
        runtime: ONNX Runtime Web.
        spec: the worlds: `world`, `robot` and `experiments` of conf/world.

    Raises:
        ValueError: the page cannot simulate the worlds, a network was trained for other maps or windows, or the page is
            larger than 25 MB.
    """
    _check_worlds(spec)
    steps = networks[0].steps
    for network in networks:
        _check_network(network, spec["world"], steps)
    environment = Environment(loader=PackageLoader("repro.demo", "assets"), autoescape=True, undefined=StrictUndefined)
    lidar = spec["robot"]["sensors"][0]
    motions = {each["motion"]["name"]: each["motion"] for each in spec["experiments"].values()}
    settings = {
        "spec": spec | {"motions": motions},
        "steps": steps,
        "networks": [_describe(network) for network in networks],
    }
    page: str = environment.get_template("index.html").render(
        style=_read("style.css"),
        loader=_read("loader.js"),
        modules=htmlsafe_json_dumps(link_modules(runtime)),
        settings=htmlsafe_json_dumps(settings),
        wasm=_pack(runtime.wasm),
        weights=[_pack(network.onnx) for network in networks],
        networks=networks,
        experiments={name: _experiment(name, each) for name, each in spec["experiments"].items()},
        experiment=_default_experiment(networks[0], spec),
        motions={name: MOTIONS.get(name, name) for name in motions},
        size=networks[0].grid.size_px,
        size_m=f"{networks[0].grid.size_m:g}",
        steps=steps,
        seconds=f"{steps * spec['world']['step_time']:g}",
        beams=lidar["number"],
        range_max=f"{lidar['range_max']:g}",
        runtime=VERSION,
    )
    if len(page.encode()) > MAX_BYTES:
        sizes = ", ".join(f"{network.title} {len(network.onnx) / 1e6:.1f} MB" for network in networks)
        raise InputError(
            f"the page has {len(page) / 1e6:.1f} MB, at most {MAX_BYTES / 1e6:.0f} are allowed: name fewer or smaller "
            f"networks with demo.networks= (now {sizes})"
        )
    return page


def _check_worlds(spec: dict[str, Any]) -> None:
    """Check that world.js and motions.js can simulate the experiments: one kind of obstacles, the paper's motions."""
    for name, experiment in spec["experiments"].items():
        motion, obstacles = experiment["motion"]["name"], experiment["obstacles"]
        if motion not in MOTIONS:
            problem = f"the motion {motion}, expected {' or '.join(MOTIONS)}"
        elif experiment["motion"].get("turned_rad"):
            problem = "a turned motion"
        elif experiment.get("fixed"):
            problem = "fixed obstacles"
        elif not isinstance(obstacles, dict) or "count" not in obstacles:
            problem = "several kinds of obstacles"
        elif "shapes" in obstacles:
            problem = "shapes other than discs and rectangles"
        else:
            continue
        raise InputError(f"the demo cannot simulate experiment {name}, which has {problem}: use world=paper")


def _check_network(network: DemoNetwork, world: dict[str, Any], steps: int) -> None:
    """Check that a network predicts maps of the worlds, from windows of the page."""
    found = (network.grid.size_m, network.steps, network.step_s)
    expected = (world["width"], steps, world["step_time"])
    if found != expected:
        found_words, expected_words = (
            f"maps of {size_m:g} m from {count} steps of {step_s:g} s" for size_m, count, step_s in (found, expected)
        )
        raise InputError(f"demo.networks: {network.title} predicts {found_words}, this page needs {expected_words}")


def link_modules(runtime: Runtime) -> dict[str, str]:
    """Return the source of all JavaScript modules of the page, each after those that it imports."""
    sources = {path.name: path.read_text(encoding="utf-8") for path in ASSETS.glob("*.js") if path.name != "loader.js"}
    sources[RUNTIME_MODULE] = runtime.script
    graph = {name: IMPORTS.findall(source) for name, source in sources.items() if name != RUNTIME_MODULE}
    return {name: sources[name] for name in TopologicalSorter(graph).static_order()}


def _describe(network: DemoNetwork) -> dict[str, Any]:
    return {
        "title": network.title,
        "note": network.note,
        "encoding": network.encoding,
        "grid": asdict(network.grid),
    }


def _experiment(name: str, experiment: dict[str, Any]) -> str:
    obstacles = "moving" if is_moving(experiment) else "static"
    return f"{name}: {obstacles}, robot {'rotates' if experiment['motion']['name'] == 'rotate' else 'drives'}"


def _default_experiment(network: DemoNetwork, spec: dict[str, Any]) -> str:
    """Return the experiment in which a network was trained, the last one if that is unknown."""
    known = list(spec["experiments"])
    return network.experiment if network.experiment and network.experiment in known else known[-1]


def _read(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")


def _pack(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()
