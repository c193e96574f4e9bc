"""What a call does: one function a task. This, `calls` and `outcomes` alone take the whole configuration."""

import dataclasses
import sys

from repro.calls import outputs_of, recordings_of, run_config, run_of
from repro.config import NETWORKS, Config, Task, world_spec
from repro.messages import announce
from repro.outcomes import animate, curves, evaluate_rival, evidence, export, publish, readme, report, transfer, verify
from repro.provenance import Status
from repro.studies import Study

# done for all runs together
ONCE = (Task.report, Task.evidence, Task.curves, Task.plan, Task.status, Task.publish, Task.verify, Task.readme)


def record(config: Config) -> None:
    """Records what is missing of an experiment."""
    directory = recordings_of(config)
    is_new = not (directory / "manifest.json").is_file()
    announce(f"{'recording' if is_new else 'checking'} {directory}")
    from repro.simulation.store import record_experiment, record_part  # after the word, for these import IR-SIM

    pairs, runtime = dataclasses.asdict(config.scale.pairs), config.runtime
    spec, part = world_spec(config.world, config.exp), (runtime.part, runtime.parts)
    if runtime.parts > 1 and not record_part(directory, spec, pairs, *part, workers=runtime.workers):
        print(f"recorded part {runtime.part} of {runtime.parts}; whichever is recorded last completes {directory}")
        return
    record_experiment(directory, spec, pairs, workers=runtime.workers)
    if is_new or config.task is Task.record:
        describe_recordings(config)


def describe_recordings(config: Config) -> None:
    """Says how the recorded worlds compare with what the paper's tables imply."""
    from repro.evaluation.visibility import describe
    from repro.maps.grid import Grid
    from repro.reporting.paper import targets

    data = run_config(config).data
    found, aim = describe(recordings_of(config), "test", Grid(data.size_px, data.size_m)), targets(config.exp)
    count = sum(dataclasses.asdict(config.scale.pairs).values())
    print(f"exp {config.exp}: {count} recordings in {recordings_of(config)}; of the test maps:")
    print(f"  coverage {found['coverage']:.4f}" + (f", the paper implies {aim['coverage']:.4f}" if aim else ""))
    above = f", to be above the paper's specificity {aim['specificity']:.4f}" if aim else ""
    print(f"  visibility {found['visibility']:.4f}{above}")


def train(config: Config) -> Status:
    """Trains one network, unless that is done, and measures it on the validation set."""
    run, runtime = run_of(config), config.runtime
    run.prepare(run_config(config))
    if not run.is_trained:
        place = Study(outputs_of(config), config.seed).place(run)
        announce(f"{place}, {run}" if place else f"training {run}")
    from repro.evaluation import predictions  # after the word, for these import torch
    from repro.evaluation.metrics import one_line
    from repro.learning import training

    status = training.train(
        run,
        recordings_of(config),
        accelerator=runtime.accelerator,
        precision=runtime.precision,
        compile=runtime.compile,
        max_minutes=runtime.max_minutes,
    )
    if status is Status.paused:
        print(f"paused {run}: the budget is spent, the same command goes on from here")
    elif not (run.path / "validation.csv").is_file():
        row = predictions.validate(run, recordings_of(config), accelerator=runtime.accelerator)
        print(f"{run}, validation: {one_line(row)}")
    return status


def evaluate(config: Config) -> None:
    """Evaluates one trained network, unless that is done, and the quick rivals that stand beside it in the tables."""
    from repro.evaluation import predictions
    from repro.evaluation.metrics import one_line
    from repro.evaluation.rivals import QUICK

    run = run_of(config)
    run.prepare(run_config(config))
    if run.is_evaluated:
        print(f"done already: {run}")
    else:
        announce(f"evaluating {run}")
        row = predictions.evaluate(run, recordings_of(config), accelerator=config.runtime.accelerator)
        print(f"{run}, test: {one_line(row)}")
    for name in QUICK:
        evaluate_rival(outputs_of(config), run_config(config), name)


def all_steps(config: Config) -> None:
    """Records what is missing, trains, evaluates."""
    if not run_of(config).is_evaluated:
        record(config)
    if train(config) is not Status.paused:
        evaluate(config)


def world(config: Config) -> None:
    """Writes the world of one seed and its twin as plain IR-SIM YAML."""
    from repro.simulation.worlds import sample_world, turn_around, write_world

    sampled = sample_world(world_spec(config.world, config.exp), config.seed)
    for name, item in (("ccw", sampled), ("cw", turn_around(sampled))):
        path = outputs_of(config).worlds / f"exp{config.exp}-seed{config.seed}-{name}.yaml"
        write_world(item, path)
        print(path)


def plan(config: Config) -> None:
    """Says what is left of the whole study at this scale, and what it costs on this machine."""
    print(f"looking at what is done in {config.outputs}, and measuring the networks on this machine", flush=True)
    from repro.simulation.shards import recordings_in

    outputs, pairs = outputs_of(config), dataclasses.asdict(config.scale.pairs)
    there = [recordings_in(outputs.recordings(experiment), pairs) for experiment in config.world["experiments"]]
    recordings = sum(pairs.values()) * len(there) - sum(there)
    cells = Study(outputs, config.seed).runs()
    left = {name: sum(cell[1] == name and not run.is_trained for cell, run in cells.items()) for name in NETWORKS}
    from repro.learning.planning import plan_study

    for line in plan_study(config.scale, config.runtime.precision, recordings, left):
        print(line, flush=True)


def status(config: Config) -> None:
    """Says what is recorded, trained, paused, failed and evaluated, and what is missing."""
    from repro.reporting.status import describe_outputs

    print(describe_outputs(outputs_of(config), list(config.world["experiments"]), config.scale.pairs, config.seed))


def warn_of_cost(configs: list[Config]) -> None:
    """Says what the trainings of a call at paper scale cost on a machine without a GPU, and how to ask for less."""
    trainings = [c for c in configs if c.task in (Task.all, Task.train) and c.scale.name == "paper"]
    left = [config for config in trainings if not run_of(config).is_trained]
    if left:
        announce("measuring what paper scale costs on this machine")
        from repro.learning.planning import cost_warning

        text = cost_warning([config.model.name for config in left], left[0].scale, left[0].runtime.precision)
        if text:
            print(text, file=sys.stderr, flush=True)


TASKS = {
    Task.all: all_steps,
    Task.record: record,
    Task.train: train,
    Task.evaluate: evaluate,
    Task.report: report,
    Task.evidence: evidence,
    Task.curves: curves,
    Task.transfer: transfer,
    Task.animate: animate,
    Task.plan: plan,
    Task.status: status,
    Task.world: world,
    Task.publish: publish,
    Task.verify: verify,
    Task.export: export,
    Task.readme: readme,
}
