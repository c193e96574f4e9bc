"""task=export: write the network of one run with a model card, as published weights or as an ONNX file."""

from repro.cli.jobs import Job
from repro.reporting.export import export_onnx, export_weights


def run(job: Job) -> None:
    """Write the weights as float16 into reproduce/results, or with format=onnx an ONNX file into the outputs."""
    name = f"exp{job.key.experiment}-{job.key.model}"
    if job.format == "onnx":
        target = job.outputs.path / "exports" / name
        difference = export_onnx(job.run, target)
        print(f"{target}: the probabilities of ONNX Runtime differ from those of torch by {difference:.1e} at most")
        return
    target = job.published / name
    export_weights(job.run, target, force=job.force)
    print(target)
