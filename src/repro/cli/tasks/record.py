"""task=record: record what is missing of an experiment."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task
from repro.system.progress import say


def run(job: Job) -> None:
    """Record an experiment; compare it with what the paper's tables imply and with the published one."""
    directory = job.recordings
    is_new = not (directory / "manifest.json").is_file()
    say(f"{'recording' if is_new else 'checking'} {directory}: {sum(job.pairs.values())} recordings")
    from repro.simulation.recorder import record_experiment  # takes seconds

    record_experiment(directory, job.spec, job.pairs, workers=job.call.runtime.workers)
    if is_new or job.call.task == "record":
        _describe(job)


def _describe(job: Job) -> None:
    from repro.evaluation.coverage import coverage_and_visibility
    from repro.maps.grid import Grid
    from repro.recordings.reader import open_recordings
    from repro.reporting.paper import are_papers, targets
    from repro.reporting.results import read_origins, recordings_of

    data, experiment = job.config.data, job.key.experiment
    recordings = open_recordings(job.recordings)
    found = coverage_and_visibility(recordings, "test", Grid(data.size_px, data.size_m))
    target = targets(experiment) if are_papers(data.worlds) else {}
    bound = f", must exceed the paper's specificity {target['specificity']:.4f}" if target else ""
    lines = [
        f"exp {experiment}: {sum(job.pairs.values())} recordings in {job.recordings}; of the test maps:",
        f"  coverage {found['coverage']:.4f}" + (f", the paper implies {target['coverage']:.4f}" if target else ""),
        f"  visibility {found['visibility']:.4f}{bound}",
    ]
    published = recordings_of(read_origins(job.reference), experiment) if job.reference.is_dir() else set()
    if published:
        same = recordings.hash(job.pairs) in published
        equal = "equal to" if same else "different in worlds, rounding or number of pairs from"
        lines.append(f"  {equal} the recordings of {job.reference}")
    say("\n".join(lines))


TASK = Task(run, "recordings")
