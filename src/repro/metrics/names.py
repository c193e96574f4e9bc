"""Names and headings of the metrics; imports no numerical library."""

METRICS = ("ssim", "accuracy", "dice", "precision", "recall", "specificity")  # the paper's six, in its order
EXTRA_METRICS: tuple[str, ...] = ()  # more columns of the tables, from `scores.py`
TABLE_METRICS = METRICS + EXTRA_METRICS
HEADINGS = {
    "ssim": "SSIM",
    "accuracy": "Acc.",
    "dice": "Dice",
    "precision": "Prec.",
    "recall": "Recall",
    "specificity": "Spec.",
    "obstacle_iou": "Obstacle IoU",
}
SUMMARY = {name: HEADINGS[name] for name in ("accuracy", "specificity", "obstacle_iou")}  # of summaries, with headings
