"""What the analysis of an outputs directory depends on."""

from repro.cli.jobs import ROOT
from repro.reporting.paper import WORLDS
from repro.reporting.uptodate import inputs_hash
from repro.runs.outputs import Outputs

CLAIMS = ROOT / "reproduce" / "claims.yaml"
GENERALIZATION = "generalization"  # rows of task=generalization, and the name of their file


def analysis_inputs(outputs: Outputs) -> str:
    """Return a hash of everything that the analysis depends on."""
    others = [*outputs.curves.glob("*.csv"), outputs.analysis / f"{GENERALIZATION}.csv", CLAIMS, WORLDS]
    return inputs_hash(outputs, [*others, *sorted(outputs.figures.glob("*.png"))])
