"""task=curves: fit learning curves to every U-Net beside an outputs directory and extrapolate them to paper scale."""

from repro.cli.jobs import Job
from repro.evaluation.learning_curves import CURVE, extrapolate, read_points
from repro.metrics.names import METRICS
from repro.reporting.paper import read_paper
from repro.reporting.summaries import extrapolated_to_markdown
from repro.runs.directories import Outputs
from repro.system.files import write_text


def run(job: Job) -> None:
    """Write curves.csv and extrapolated.csv.

    Raises:
        ValueError: no curve has enough points.
    """
    target = job.outputs.curves
    directories = sorted({path.parent for above in (target.parent, target) for path in above.glob("*/runs")})
    points = read_points([Outputs(directory) for directory in directories if directory.name != "smoke"])
    extrapolated = extrapolate(points) if len(points) else points
    if extrapolated.empty:
        raise ValueError(f"no curve has 4 points in {target.parent}: make curves trains them")
    paper = read_paper().query("model == 'unet'").melt(CURVE, METRICS, var_name="metric", value_name="paper")
    extrapolated = extrapolated.merge(paper, on=[*CURVE, "metric"], how="left")
    target.mkdir(parents=True, exist_ok=True)
    for name, frame in {"curves": points, "extrapolated": extrapolated}.items():
        write_text(target / f"{name}.csv", frame.to_csv(index=False, float_format="%.6g"))
    print(extrapolated_to_markdown(extrapolated))
    print(f"{target}: task=analysis shows it")
