"""One entry point: maps a task to one function of `repro`. The only file that knows Hydra.

python run.py task=record exp=3                                        simulate and store one experiment
python run.py exp=3 model=unet                                         record what is missing, train, evaluate
python run.py -m model=unet,fpn,upernet,segformer exp=3,4 decay=false  a sweep, then the tables
python run.py task=report                                              tables and figures from what is there
python run.py task=world exp=3 seed=17                                 write one world and its twin as IR-SIM YAML
"""

import sys
from pathlib import Path
from typing import Any, ClassVar

import hydra
from hydra.core.config_store import ConfigStore
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from repro.config import Config, Task, known_experiment, place, plain, world_spec

ROOT = Path(__file__).parent

OmegaConf.register_new_resolver("place", place, replace=True)
OmegaConf.register_new_resolver("known", known_experiment, replace=True)
OmegaConf.register_new_resolver("decay", lambda decay: "decay" if decay else "no-decay", replace=True)
ConfigStore.instance().store(name="schema", node=Config)


class TablesAtTheEnd(Callback):
    """Notes whose tables are due when a multirun ends, also when a job of it failed.

    Hydra skips `on_multirun_end` then, so the bottom of this file prints them.
    """

    due: ClassVar[list[Path]] = []

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        if config.task in (Task.all, Task.evaluate):
            self.due.append(Path(config.outputs))


def print_tables(outputs: Path) -> None:
    """Writes the tables of whatever runs there are and prints them."""
    from repro.reporting.tables import write_tables

    for page in write_tables(outputs).values():
        print("\n" + page)
    print(f"Tables: {outputs / 'tables'}")


def with_values(config: DictConfig, **values: Any) -> DictConfig:
    """The configuration with other values of some keys."""
    return OmegaConf.merge(config, values)  # type: ignore[return-value]


def run_config(config: DictConfig, model: dict[str, Any]) -> dict[str, Any]:
    """What decides the result of a run, as plain values; it becomes the run's config.yaml."""
    from repro.simulation.store import spec_fingerprint

    return {
        "experiment": config.exp,
        "decay": config.decay,
        "seed": config.seed,
        "model": model,
        "data": {
            "size_px": config.scale.size_px,
            "lightest": config.lightest,
            "pairs": plain(config.scale.pairs),
            "worlds": spec_fingerprint(world_spec(config.world, config.exp)),
        },
        "train": plain(config.train),
    }


def recordings(config: DictConfig) -> Path:
    return Path(config.outputs) / "recordings" / f"exp{config.exp}"


def record(config: DictConfig) -> None:
    """Records an experiment, says how it compares with the paper, and evaluates the simple predictors on it."""
    from repro.evaluation.predictions import BASELINES, evaluate_baseline
    from repro.maps.datasets import describe
    from repro.maps.grid import Grid
    from repro.reporting.paper import targets
    from repro.runs import prepare_run, run_directory
    from repro.simulation.store import record_experiment

    directory, pairs = recordings(config), plain(config.scale.pairs)
    is_new = not (directory / "manifest.json").is_file()
    record_experiment(directory, world_spec(config.world, config.exp), pairs, workers=config.runtime.workers)
    for name in BASELINES:
        run = run_directory(Path(config.outputs), config.exp, name, True, 0)
        untrained = run_config(with_values(config, seed=0, decay=True), {"name": name})
        del untrained["train"]
        prepare_run(run, untrained)
        evaluate_baseline(run, directory)
    if not is_new and config.task is not Task.record:
        return
    found, aim = describe(directory, Grid(config.scale.size_px)), targets(config.exp)
    print(f"exp {config.exp}: {sum(pairs.values())} runs in {directory}; of the test maps:")
    print(f"  coverage {found['coverage']:.4f}" + (f", the paper implies {aim['coverage']:.4f}" if aim else ""))
    above = f", to be above the paper's specificity {aim['specificity']:.4f}" if aim else ""
    print(f"  visibility {found['visibility']:.4f}{above}")


def train(config: DictConfig) -> str:
    """Trains one network, unless that is done; returns `finished` or `paused`."""
    from repro.evaluation import predictions
    from repro.evaluation.metrics import one_line
    from repro.learning import training
    from repro.runs import prepare_run, read_status

    run = Path(config.outputs) / config.run
    prepare_run(run, run_config(config, plain(config.model)))
    if read_status(run) not in ("finished", "evaluated"):
        print(f"training {run}", flush=True)
        warn_of_cost(config)
    options = {key: config.runtime[key] for key in ("accelerator", "precision", "compile", "max_minutes")}
    status = training.train(run, recordings(config), **options)
    if status == "paused":
        print(f"paused {run}: the budget is spent, the same command goes on from here")
    elif not (run / "validation.csv").is_file():
        row = predictions.validate(run, recordings(config), accelerator=config.runtime.accelerator)
        print(f"{run}, validation: {one_line(row)}")
    return status


def evaluate(config: DictConfig) -> None:
    """Evaluates one trained network, unless that is done."""
    from repro.evaluation import predictions
    from repro.evaluation.metrics import one_line
    from repro.runs import read_status

    run = Path(config.outputs) / config.run
    if read_status(run) == "evaluated":
        print(f"done already: {run}")
        return
    row = predictions.evaluate(run, recordings(config), accelerator=config.runtime.accelerator)
    print(f"{run}, test: {one_line(row)}")


def all_steps(config: DictConfig) -> None:
    """Records what is missing, trains, evaluates."""
    from repro.runs import read_status

    if read_status(Path(config.outputs) / config.run) != "evaluated":
        record(config)
    if train(config) == "finished":
        evaluate(config)


def report(config: DictConfig) -> None:
    """Rebuilds tables and figures from whatever run directories exist."""
    from repro.reporting.figures import write_figures

    outputs = Path(config.outputs)
    print_tables(outputs)
    specs = {exp: world_spec(config.world, exp) for exp in config.world.experiments}
    for path in write_figures(outputs, specs):
        print(f"Figure: {path}")


def publish(config: DictConfig) -> None:
    """Copies what this scale has measured into reproduce/results, and its tables into README.md."""
    from repro.reporting import publish

    print(publish.publish(Path(config.outputs), ROOT / "reproduce" / "results", config.scale.name))
    readme(config)


def export(config: DictConfig) -> None:
    """Writes the weights of one run as float16 with a model card into reproduce/results."""
    from repro.reporting.publish import export_weights

    target = ROOT / "reproduce" / "results" / config.scale.name / f"exp{config.exp}-{config.model.name}"
    export_weights(Path(config.outputs) / config.run, target)
    print(target)


def readme(config: DictConfig) -> None:
    """Makes the tables of README.md anew from reproduce/results."""
    from repro.reporting.publish import readme_with_results

    path = ROOT / "README.md"
    path.write_text(readme_with_results(path.read_text(), ROOT / "reproduce" / "results"))


def world(config: DictConfig) -> None:
    """Writes the world of one seed and its twin as plain IR-SIM YAML."""
    from repro.simulation.worlds import sample_world, turn_around, write_world

    sampled = sample_world(world_spec(config.world, config.exp), config.seed)
    for name, item in (("ccw", sampled), ("cw", turn_around(sampled))):
        path = Path(config.outputs) / "worlds" / f"exp{config.exp}-seed{config.seed}-{name}.yaml"
        write_world(item, path)
        print(path)


def plan(config: DictConfig) -> None:
    """Says what the whole study costs at this scale on this machine."""
    from repro.learning.planning import plan_study

    print(plan_study(plain(config.scale), config.runtime.precision))


def warn_of_cost(config: DictConfig) -> None:
    """Says what one training at paper scale costs on a machine without a GPU, and how to ask for less."""
    from repro.learning.planning import cost_warning

    if config.scale.name == "paper":
        text = cost_warning(config.model.name, plain(config.scale), config.runtime.precision)
        if text:
            print(text, file=sys.stderr, flush=True)


TASKS = {
    Task.all: all_steps,
    Task.record: record,
    Task.train: train,
    Task.evaluate: evaluate,
    Task.report: report,
    Task.plan: plan,
    Task.world: world,
    Task.publish: publish,
    Task.export: export,
    Task.readme: readme,
}


@hydra.main(version_base="1.3", config_path="conf", config_name="config")
def main(config: DictConfig) -> None:
    TASKS[config.task](config)


if __name__ == "__main__":
    try:
        main()
    finally:
        for outputs in TablesAtTheEnd.due:
            print_tables(outputs)
