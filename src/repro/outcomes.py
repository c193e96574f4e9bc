"""The tasks that read what has been evaluated: tables, figures, evidence, what is published."""

import dataclasses
import itertools
import sys
from pathlib import Path

from repro.calls import RESULTS, ROOT, outputs_of, run_of
from repro.config import NETWORKS, Config, Encoding, Model, variant, world_spec
from repro.messages import JobFailed, announce
from repro.runs import Outputs, RunConfig


def print_tables(outputs: Outputs) -> int:
    """Writes the tables of whatever runs there are and prints them; returns 1 when a run had to be left out."""
    from repro.reporting.tables import write_tables

    faults: list[str] = []
    for table in write_tables(outputs, faults).values():
        print("\n" + table.to_markdown())
    print(f"Tables: {outputs.tables}", flush=True)
    for fault in faults:
        print(f"error: left out of the tables: {fault}", file=sys.stderr)
    return int(bool(faults))


def report(config: Config) -> None:
    """Rebuilds tables and figures from whatever run directories exist."""
    from repro.evaluation.examples import load_example
    from repro.reporting.figures import write_figures
    from repro.simulation.shards import SPLITS
    from repro.simulation.store import read_manifest
    from repro.simulation.worlds import sample_world

    outputs = outputs_of(config)
    left_out = print_tables(outputs)
    specs = {experiment: read_manifest(path).spec for experiment, path in outputs.recorded().items()}
    worlds = {experiment: sample_world(spec, SPLITS["test"]) for experiment, spec in specs.items()}
    examples = []
    for decay, experiment in itertools.product((True, False), specs):
        try:
            if outputs.run(experiment, "unet", variant("projection", decay), 0).is_evaluated:
                examples.append(load_example(outputs, experiment, decay=decay))
        except ValueError as error:
            print(f"error: left out of the figures: {error}", file=sys.stderr)
            left_out = 1
    for path in write_figures(outputs.figures, worlds, examples):
        print(f"Figure: {path}")
    if left_out:
        raise JobFailed("some runs are left out of the tables or figures")


def evidence(config: Config) -> None:
    """Measures what the tables do not say, judges the paper's claims, and writes the page."""
    import pandas as pd

    from repro.evaluation.evidence import gather
    from repro.evaluation.rivals import RIVALS
    from repro.files import write_text
    from repro.reporting.claims import judge, read_claims
    from repro.reporting.evidence_figures import write_evidence_figures
    from repro.reporting.numbers import evidence_rows
    from repro.reporting.results import audits, caption, read_results
    from repro.reporting.tables import write_tables

    outputs = outputs_of(config)
    results = read_results(outputs)
    if results.empty or not results["model"].isin(NETWORKS).any():
        raise ValueError(f"no network has been evaluated in {outputs.path}: train some first")
    settings = {run.config().experiment: run.config() for run in outputs.runs() if run.config().train}
    for experiment, name in itertools.product(sorted(settings), RIVALS):
        evaluate_rival(outputs, settings[experiment], name)
    tables = write_tables(outputs)
    announce(f"measuring {len(results)} runs, about {3 * len(results)} s")
    frames = gather(outputs)
    transferred = outputs.evidence / "transfer.csv"
    if transferred.is_file():
        frames["transfer"] = pd.read_csv(transferred, dtype={"trained": str, "tested": str})
    for path in _curves_of(outputs).glob("*.csv"):
        frames[path.stem] = pd.read_csv(path, dtype={"experiment": str})
    frames["audit"] = audits(results)
    frames["claims"] = judge(read_claims(ROOT / "reproduce" / "claims.yaml"), evidence_rows(frames))
    outputs.evidence.mkdir(parents=True, exist_ok=True)
    for name, frame in frames.items():
        write_text(outputs.evidence / f"{name}.csv", frame.to_csv(index=False, float_format="%.6g"))
    write_evidence_figures(outputs.evidence, frames)
    verdicts = frames["claims"]["verdict"].value_counts()
    print("claims of the paper: " + ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items()))
    write_page(config, frames, caption(results), tables)


def curves(config: Config) -> None:
    """Fits learning curves to every U-Net below the directories beside the outputs, and foretells paper scale."""
    from repro.evaluation.curves import CURVE, foretell, read_points
    from repro.evaluation.metrics import METRICS
    from repro.files import write_text
    from repro.reporting.digest import foretold_to_markdown
    from repro.reporting.paper import read_paper

    target = _curves_of(outputs_of(config))
    places = sorted({path.parent for above in (target.parent, target) for path in above.glob("*/runs")})
    points = read_points([Outputs(place) for place in places if place.name != "smoke"])
    foretold = foretell(points) if len(points) else points
    if foretold.empty:
        raise ValueError(f"no curve has 4 points in {target.parent}: make curves trains them")
    paper = read_paper().query("model == 'unet'").melt(CURVE, METRICS, var_name="metric", value_name="paper")
    foretold = foretold.merge(paper, on=[*CURVE, "metric"], how="left")
    target.mkdir(parents=True, exist_ok=True)
    for name, frame in {"curves": points, "foretold": foretold}.items():
        write_text(target / f"{name}.csv", frame.to_csv(index=False, float_format="%.6g"))
    print(foretold_to_markdown(foretold))
    print(f"{target}: task=evidence shows it")


def _curves_of(outputs: Outputs) -> Path:
    """Where learning curves lie: beside the outputs directories that they are made from."""
    return outputs.path.parent / "curves"


def transfer(config: Config) -> None:
    """Tests U-Net on other experiments than its own, and on changed sensors, poses and speeds."""
    import pandas as pd

    from repro.evaluation.transfer import across_experiments, under_changes
    from repro.files import write_text
    from repro.prediction import load_predictor
    from repro.simulation.store import read_manifest

    outputs = outputs_of(config)
    runs = {name: outputs.run(name, "unet", "decay", config.seed) for name in sorted(outputs.recorded())}
    predictors = {name: load_predictor(run.model) for name, run in runs.items() if run.is_trained}
    if not predictors:
        raise ValueError(f"no U-Net with seed {config.seed} has been trained in {outputs.path}: train some first")
    announce(f"testing U-Net of experiments {', '.join(predictors)} on one another's recordings")
    rows = [across_experiments(predictors, {name: outputs.recordings(name) for name in predictors})]
    if config.exp in predictors:
        announce(f"testing U-Net of experiment {config.exp} on changed sensors, poses and speeds")
        spec, pairs = read_manifest(outputs.recordings(config.exp)).spec, min(config.scale.pairs.test, 100)
        where = outputs.path / "transfer" / f"exp{config.exp}"
        rows.append(under_changes(predictors[config.exp], config.exp, spec, where, pairs))
    outputs.evidence.mkdir(parents=True, exist_ok=True)
    table = pd.concat(rows, ignore_index=True).assign(seed=config.seed)
    write_text(outputs.evidence / "transfer.csv", table.to_csv(index=False, float_format="%.6g"))
    print(f"{outputs.evidence / 'transfer.csv'}: task=evidence shows it")


def write_page(config: Config, frames: dict, words: str, tables: dict) -> None:
    """Writes outputs/<scale>/report.html."""
    from repro.evaluation.samples import load_samples
    from repro.files import write_text
    from repro.reporting.page import Report, render

    outputs = outputs_of(config)
    runs = [run for run in outputs.runs() if run.is_evaluated]
    shown: dict[str, list] = {}
    for run in runs:
        settings = run.config()
        if settings.seed == 0 and settings.model.name != "all_free":
            shown.setdefault(settings.experiment, []).append(run)
    report = Report(
        scale=config.scale.name,
        place=outputs.path.name,
        command=f"python run.py task=evidence scale={config.scale.name}",
        caption=words,
        tables=tables,
        frames=frames,
        claims=frames["claims"],
        figures={path.stem: path for folder in (outputs.figures, outputs.evidence) for path in folder.glob("*.png")},
        samples={experiment: load_samples(outputs, experiment, mine) for experiment, mine in shown.items()},
        origins={str(run.path.relative_to(outputs.path)): run.provenance() for run in runs},
    )
    write_text(outputs.path / "report.html", render(report))
    print(f"Page: {outputs.path / 'report.html'}", flush=True)


def animate(config: Config) -> None:
    """Writes a moving picture of the world of one seed, predicted step by step by the network of seed 0."""
    from repro.prediction import load_predictor
    from repro.reporting.animation import make_frames, write_animation
    from repro.simulation.recording import simulate
    from repro.simulation.worlds import sample_world

    run = outputs_of(config).run(config.exp, config.model.name, config.encoding.variant, 0)
    if not run.is_trained:
        raise ValueError(f"{run} is not trained: train it first, with the same words and seed=0")
    world = sample_world(world_spec(config.world, config.exp), config.seed)
    announce(f"simulating and drawing world {config.seed} of experiment {config.exp}")
    recording = simulate(world)
    frames = make_frames(recording, load_predictor(run.model))
    path = outputs_of(config).worlds / f"exp{config.exp}-seed{config.seed}"
    path.parent.mkdir(parents=True, exist_ok=True)
    size_m, range_max_m = world["world"]["width"], world["robot"]["sensors"][0]["range_max"]
    for written in write_animation(recording, frames, path, size_m=size_m, range_max_m=range_max_m):
        print(written)


def publish(config: Config) -> None:
    """Copies what this scale has measured into reproduce/results, and its tables into README.md."""
    from repro.reporting import publish

    target = RESULTS / Path(config.outputs).name
    print(f"{'replacing' if target.exists() else 'publishing'} {target}")
    publish.publish(outputs_of(config), RESULTS, config.scale.name, force=config.publish.force)
    readme(config)


def verify(config: Config) -> None:
    """Says whether the runs here came out as those published at this scale, and writes verification.csv."""
    from repro.files import write_text
    from repro.reporting import verification

    outputs = outputs_of(config)
    compared = verification.verify(outputs, RESULTS / config.scale.name)
    print(verification.verification_to_markdown(compared))
    path = outputs.path / "verification.csv"
    write_text(path, compared.to_csv(index=False, float_format="%.6g"))
    print(path)


def export(config: Config) -> None:
    """Writes the weights of one run as float16 with a model card into reproduce/results."""
    from repro.reporting.publish import export_weights

    target = RESULTS / config.scale.name / f"exp{config.exp}-{config.model.name}"
    export_weights(run_of(config), target, force=config.publish.force)
    print(target)


def readme(config: Config) -> None:
    """Makes the tables of README.md anew from reproduce/results."""
    from repro.files import write_text
    from repro.reporting.readme import readme_with_results

    path = ROOT / "README.md"
    write_text(path, readme_with_results(path.read_text(), RESULTS))


def evaluate_rival(outputs: Outputs, settings: RunConfig, name: str) -> None:
    """Evaluates a rival, unless that is done, on the worlds and the grid of some run."""
    from repro.evaluation import predictions

    encoding = Encoding("projection", {"decay": True, "oldest_gray": 0.8})  # a rival draws no images
    rival = outputs.run(settings.experiment, name, encoding.variant, 0)
    rival.prepare(dataclasses.replace(settings, model=Model(name), encoding=encoding, seed=0, train=None))
    if not rival.is_evaluated:
        announce(f"evaluating {rival}")
    predictions.evaluate(rival, outputs.recordings(settings.experiment))
