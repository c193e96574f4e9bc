"""The evidence in a few lines of Markdown, for the README."""

import pandas as pd

from repro.config import LEARNED
from repro.names import NAMES, predictor_title

SHOWN = {"accuracy": "Acc.", "specificity": "Spec.", "obstacle_iou": "Obstacle IoU"}


def claims_to_markdown(claims: pd.DataFrame) -> str:
    """Writes the verdicts: how many of each, then one row a claim with our number and the paper's.

    Args:
        claims: see `claims.judge`.
    """
    counts = claims["verdict"].value_counts()
    summary = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    lines = [
        f"**{summary}.** Numbers are those of the test",
        "that is nearest to failing, with an interval of 95 % and what is needed.",
        "",
        "| The paper says | Verdict | Ours | The paper's own |",
        "|---|---|---|---|",
    ]
    for _, row in claims.iterrows():
        ours = ""
        if pd.notna(row["value"]):
            needed = f"{row['claimed']:.3g} ± {row['tolerance']:.2g}"
            ours = f"{row['value']:.3f} [{row['low']:.3f}, {row['high']:.3f}] ({needed})"
        paper = f"{row['paper']}, {row['paper_value']:.3f}" if pd.notna(row["paper_value"]) else ""
        lines.append(f"| {row['quote']} | {row['verdict']} | {ours} | {paper} |")
    return "\n".join(lines) + "\n"


def methods_to_markdown(intervals: pd.DataFrame, words: str) -> str:
    """Writes U-Net from every encoding, the other networks and the rivals, experiments side by side.

    Args:
        intervals: experiment, model, encoding, decay, metric, value, low, high, seeds.
        words: the caption.
    """
    rows = intervals[intervals["decay"] & intervals["metric"].isin(SHOWN) & (intervals["model"] != "average")]
    inputs = rows.groupby("experiment")["encoding"].nunique()
    chosen = sorted(inputs.index[inputs == inputs.max()])  # where most inputs have been tried
    rows = rows[rows["experiment"].isin(chosen)]
    lines = [
        f"**{words}**",
        "",
        "| Predicted by | Seeds | " + " | ".join(f"Exp. {e}: {head}" for e in chosen for head in SHOWN.values()) + " |",
        "|---|---|" + "---|" * (len(chosen) * len(SHOWN)),
    ]
    order, known = list(NAMES), set(zip(rows["model"], rows["encoding"], strict=True))
    for model, encoding in sorted(known, key=lambda cell: (order.index(cell[0]), cell[1] != "projection", cell[1])):
        mine = rows[(rows["model"] == model) & (rows["encoding"] == encoding)]
        values = [_cell(mine, experiment, metric) for experiment in chosen for metric in SHOWN]
        counts = sorted({f"{count:.0f}" for count in mine["seeds"]}) if model in LEARNED else []
        seeds = " to ".join(counts)
        lines.append(f"| {predictor_title(model, encoding)} | {seeds} | " + " | ".join(values) + " |")
    return "\n".join(lines) + "\n"


def foretold_to_markdown(foretold: pd.DataFrame) -> str:
    """Writes what learning curves foretell of U-Net at paper scale, beside the paper, and how well they foretell.

    Args:
        foretold: see `curves.foretell`, with the paper's number of each metric as `paper`.
    """
    shown = {name: head for name, head in SHOWN.items() if name in set(foretold["metric"])}
    aim, held = (foretold[foretold["what"] == what] for what in ("paper scale", "largest left out"))
    pairs, size_px = aim["pairs"].iloc[0], aim["size_px"].iloc[0]
    lines = [
        f"**U-Net at {pairs:,.0f} pairs and {size_px:.0f} px as its learning curves foretell it**, with intervals of",
        "95 % (the paper); then what they foretell of the largest training from the smaller ones: foretold, measured.",
        "",
        "| Exp. | " + " | ".join([*shown.values(), *(f"{head} left out" for head in shown.values())]) + " |",
        "|---|" + "---|" * (2 * len(shown)),
    ]
    for (experiment, decay), rows in aim.groupby(["experiment", "decay"], sort=False):
        back = held[(held["experiment"] == experiment) & (held["decay"] == decay)]
        cells = [_foretold(rows[rows["metric"] == name].iloc[0]) for name in shown]
        found = [back[back["metric"] == name].iloc[0] for name in shown]
        cells += [f"{row['value']:.3f}, {row['measured']:.3f}" for row in found]
        lines.append(f"| {experiment!s}{'' if decay else ', no decay'} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _foretold(row: pd.Series) -> str:
    paper = f" ({row['paper']:.3f})" if pd.notna(row["paper"]) else ""
    return f"{row['value']:.3f} [{row['low']:.3f}, {row['high']:.3f}]{paper}"


def _cell(rows: pd.DataFrame, experiment: str, metric: str) -> str:
    found = rows[(rows["experiment"] == experiment) & (rows["metric"] == metric)]
    return "".join(f"{row.value:.3f} [{row.low:.3f}, {row.high:.3f}]" for row in found.itertuples())
