"""Learning curves from all outputs directories beside one another, in the paper's worlds; U-Net's are extrapolated.

    python reproduce/curves.py outputs/laptop

writes curves.csv and, where the paper's U-Net has a curve, extrapolated.csv, which task=analysis shows.
"""

import sys
from pathlib import Path

from repro.evaluation.learning_curves import CURVE, FEWEST, extrapolate, read_points
from repro.metrics.names import METRICS
from repro.reporting.documents import extrapolated_to_markdown
from repro.reporting.paper import WORLDS, read_paper, worlds_of
from repro.runs.outputs import Outputs
from repro.system.files import write_text


def write_curves(outputs: Path) -> None:
    """Write the curves of an outputs directory, from its runs and those of the directories beside it."""
    target = Outputs(outputs).curves
    directories = sorted({path.parent for above in (target.parent, target) for path in above.glob("*/runs")})
    found = [Outputs(directory) for directory in directories if directory.name != "smoke"]
    points = read_points(found, worlds_of(WORLDS))
    if points.empty:
        sys.exit(f"no curve has {FEWEST} points in {target.parent}: make curves trains them")
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


if __name__ == "__main__":
    write_curves(Path(sys.argv[1]))
