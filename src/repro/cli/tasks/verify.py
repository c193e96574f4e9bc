"""task=verify: compare the runs of an outputs directory with the published ones of its name, else of its scale."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Print the comparison and write verification.csv."""
    from repro.reporting.verification import verification_to_markdown, verify
    from repro.system.files import write_text

    print(f"comparing {job.outputs.path} with {job.reference}")
    compared = verify(job.outputs, job.reference)
    print(verification_to_markdown(compared))
    path = job.outputs.path / "verification.csv"
    write_text(path, compared.to_csv(index=False, float_format="%.6g"))
    print(path)


TASK = Task(run, once=True)
