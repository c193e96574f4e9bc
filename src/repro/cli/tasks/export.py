"""task=export: write the network of one run with a model card, as published weights or as an ONNX file."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task
from repro.runs.config import PROJECTION


def run(job: Job) -> None:
    """Write the weights as float16 into reproduce/results, or with format=onnx an ONNX file into the outputs."""
    print(f"exporting {job.run}, after PyTorch is loaded", flush=True)
    from repro.reporting.network_export import export_run, export_weights

    name, seed = f"exp{job.key.experiment}-{job.key.model}", f"-seed{job.key.seed}" if job.key.seed else ""
    if job.call.format == "onnx":
        encoding = "" if job.key.encoding == PROJECTION else f"-{job.key.encoding}"
        target = job.outputs.path / "exports" / f"{name}{encoding}{seed}"
        difference = export_run(job.run, target)
        print(f"{target}: the probabilities of ONNX Runtime differ from those of torch by {difference:.1e} at most")
        return
    target = job.published / f"{name}{seed}"
    export_weights(job.run, target, force=job.call.publish.force)
    print(target)


TASK = Task(run, own=("format", "publish"))
