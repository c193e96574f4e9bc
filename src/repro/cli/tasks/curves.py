"""task=curves: learning curves from all outputs directories, in the worlds of the call; U-Net's are extrapolated."""

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Write curves.csv and, where the paper's U-Net has a curve, extrapolated.csv.

    Raises:
        InputError: no curve has enough points.
    """
    from repro.evaluation.learning_curves import CURVE, FEWEST, extrapolate, read_points
    from repro.metrics.names import METRICS
    from repro.reporting.documents import extrapolated_to_markdown
    from repro.reporting.paper import fingerprints_of, read_paper
    from repro.runs.outputs import Outputs
    from repro.system.errors import InputError
    from repro.system.files import write_text

    target = job.outputs.curves
    directories = sorted({path.parent for above in (target.parent, target) for path in above.glob("*/runs")})
    found = [Outputs(directory) for directory in directories if directory.name != "smoke"]
    points = read_points(found, fingerprints_of(job.call.world))
    if points.empty:
        raise InputError(f"no curve has {FEWEST} points in {target.parent}: make curves trains them")
    target.mkdir(parents=True, exist_ok=True)
    write_text(target / "curves.csv", points.to_csv(index=False, float_format="%.6g"))
    extrapolated = extrapolate(points)
    if extrapolated.empty:
        (target / "extrapolated.csv").unlink(missing_ok=True)
    else:
        paper = read_paper().query("model == 'unet'").melt(CURVE, METRICS, var_name="metric", value_name="paper")
        extrapolated = extrapolated.merge(paper, on=[*CURVE, "metric"], how="left")
        write_text(target / "extrapolated.csv", extrapolated.to_csv(index=False, float_format="%.6g"))
        print(extrapolated_to_markdown(extrapolated))
    print(f"{target}: task=analysis shows it")


TASK = Task(run, once=True)
