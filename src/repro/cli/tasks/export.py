"""task=export: write the weights of one run with a model card into reproduce/results."""

from repro.cli.jobs import RESULTS, Job
from repro.reporting.publish import export_weights


def run(job: Job) -> None:
    """Write the weights as float16."""
    target = RESULTS / job.scale.name / f"exp{job.key.experiment}-{job.key.model}"
    export_weights(job.run, target, force=job.force)
    print(target)
