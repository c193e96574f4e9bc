"""task=export: write the network of one run with a model card, as published weights or as an ONNX file."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task
from repro.runs.config import PROJECTION
from repro.runs.keys import RunKey


def suffix_of(key: RunKey) -> str:
    """Return the input and the seed of a network for a file name, where they are not the projection and 0."""
    return ("" if key.encoding == PROJECTION else f"-{key.encoding}") + _seed_suffix(key)


def _seed_suffix(key: RunKey) -> str:
    return f"-seed{key.seed}" if key.seed else ""


def run(job: Job) -> None:
    """Write the weights as float16 into reproduce/results, or with format=onnx an ONNX file into the outputs."""
    print(f"exporting {job.run}, after PyTorch is loaded", flush=True)
    from repro.reporting.network_export import export_run, export_weights

    name = f"exp{job.key.experiment}-{job.key.model}"
    if job.call.format == "onnx":
        target = job.outputs.path / "exports" / f"{name}{suffix_of(job.key)}"
        difference = export_run(job.run, target)
        print(f"{target}: the probabilities of ONNX Runtime differ from those of torch by {difference:.1e} at most")
        return
    target = job.published / f"{name}{_seed_suffix(job.key)}"
    export_weights(job.run, target, force=job.call.publish.force)
    print(target)


TASK = Task(run, own=("format", "publish"))
