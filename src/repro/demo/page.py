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
from repro.world_config import WorldSpec, world_spec

ASSETS = Path(str(files("repro.demo"))) / "assets"
RUNTIME_MODULE = "ort.mjs"
IMPORTS = re.compile(r'from "\./([\w.]+)"')
MAX_BYTES = 25_000_000


def render(networks: list[DemoNetwork], runtime: Runtime, world: dict[str, Any]) -> str:
    """Return the page.

    Args:
        networks: the networks to choose from; the first is selected.
        runtime: ONNX Runtime Web.
        world: `world`, `robot` and `experiments` of conf/world.

    Raises:
        ValueError: the page cannot simulate the worlds, a network was trained for other maps or windows, or the page is
            larger than 25 MB.
    """
    specs = {name: world_spec(world, name) for name in world["experiments"]}
    for name, spec in specs.items():
        if not spec.is_like_papers or spec.motion.irsim().get("turned_rad"):
            raise InputError(f"the demo cannot simulate experiment {name}, with {spec.motion.name}: use world=paper")
    spec, steps = next(iter(specs.values())), networks[0].steps
    for network in networks:
        _check_network(network, spec, steps)
    described = [{"encoding": each.encoding, "grid": asdict(each.grid)} for each in networks]
    environment = Environment(loader=PackageLoader("repro.demo", "assets"), autoescape=True, undefined=StrictUndefined)
    page: str = environment.get_template("index.html").render(
        style=(ASSETS / "style.css").read_text(encoding="utf-8"),
        loader=(ASSETS / "loader.js").read_text(encoding="utf-8"),
        modules=htmlsafe_json_dumps(link_modules(runtime)),
        settings=htmlsafe_json_dumps({"spec": world, "steps": steps, "networks": described}),
        wasm=_pack(runtime.wasm),
        weights=[_pack(network.onnx) for network in networks],
        networks=networks,
        experiments={name: _title(name, each) for name, each in specs.items()},
        experiment=networks[0].experiment if networks[0].experiment in specs else [*specs][-1],
        spec=spec,
        steps=steps,
        seconds=f"{steps * spec.world.step_time:g}",
        runtime=VERSION,
    )
    if len(page.encode()) > MAX_BYTES:
        sizes = ", ".join(f"{network.title} {len(network.onnx) / 1e6:.1f} MB" for network in networks)
        raise InputError(
            f"the page has {len(page) / 1e6:.1f} MB, at most {MAX_BYTES / 1e6:.0f} are allowed: name fewer or smaller "
            f"networks with demo.networks= (now {sizes})"
        )
    return page


def _check_network(network: DemoNetwork, spec: WorldSpec, steps: int) -> None:
    """Check that a network predicts maps of the worlds, from windows of the page."""
    found = (network.grid.size_m, network.steps, network.step_s)
    expected = (spec.world.width, steps, spec.world.step_time)
    if found != expected:
        found_words, expected_words = (
            f"maps of {size_m:g} m from {count} steps of {step_s:g} s" for size_m, count, step_s in (found, expected)
        )
        raise InputError(f"demo.networks: {network.title} predicts {found_words}, this page needs {expected_words}")


def link_modules(runtime: Runtime) -> dict[str, str]:
    """Return the source of all JavaScript modules of the page, each after those that it imports."""
    sources = {path.name: path.read_text(encoding="utf-8") for path in ASSETS.glob("*.js") if path.name != "loader.js"}
    graph = {name: IMPORTS.findall(source) for name, source in sources.items()}
    sources[RUNTIME_MODULE] = runtime.script
    return {name: sources[name] for name in TopologicalSorter(graph).static_order()}


def _title(name: str, spec: WorldSpec) -> str:
    moves = "rotates" if spec.motion.name == "rotate" else "drives"
    return f"{name}: {'moving' if spec.behaviors else 'static'}, robot {moves}"


def _pack(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()
