"""Names and headings of the metrics; imports no numerical library."""

from repro.system.plugins import plugin_names

METRICS = ("ssim", "accuracy", "dice", "precision", "recall", "specificity")  # the paper's six, in its order
EXTRA_METRICS: tuple[str, ...] = ()  # more columns, of `scores` or `image_metrics`
GROUP = "repro.image_metrics"  # entry points of other packages, whose metrics are more columns
TABLE_METRICS = METRICS + EXTRA_METRICS + plugin_names(GROUP)
HEADINGS = {
    "ssim": "SSIM",
    "accuracy": "Acc.",
    "dice": "Dice",
    "precision": "Prec.",
    "recall": "Recall",
    "specificity": "Spec.",
    "obstacle_iou": "Obstacle IoU",
    **{name: name.replace("_", " ").capitalize() for name in plugin_names(GROUP)},
}
SUMMARY = {name: HEADINGS[name] for name in ("accuracy", "specificity", "obstacle_iou")}  # of summaries, with headings
