import sys
from importlib import reload

import numpy as np
import pytest

from repro.evaluation import image_metrics
from repro.metrics import headings
from repro.system.plugins import plugins


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Return a function that installs a package with entry points."""

    def install(module: str, points: str) -> None:
        (tmp_path / "other_package.py").write_text(module)
        info = tmp_path / "other_package-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: other-package\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(points)
        monkeypatch.syspath_prepend(tmp_path)

    yield install
    sys.modules.pop("other_package", None)


METRIC = "def share(free, maps):\n    return free.mean((1, 2, 3))\n"


def test_a_metric_of_another_package_is_a_column_of_the_tables(installed, monkeypatch):
    installed(METRIC, "[repro.image_metrics]\nshare = other_package:share\n")
    try:
        reload(headings)
        assert headings.TABLE_METRICS[-1] == "share"
        assert headings.HEADINGS["share"] == "Share"
        assert reload(image_metrics).IMAGE_METRICS["share"].__module__ == "other_package"
    finally:
        monkeypatch.undo()
        reload(headings)
        reload(image_metrics)
    assert "share" not in image_metrics.IMAGE_METRICS


def test_a_plugin_that_cannot_be_imported_is_named(installed):
    installed("import nothing_of_this_name", "[repro.architectures]\nbroken = other_package:Network\n")
    with pytest.raises(ValueError, match=r"broken of other-package cannot be imported \(No module"):
        plugins("repro.architectures", ())


def test_a_plugin_does_not_replace_what_is_there(installed):
    installed(METRIC, "[repro.image_metrics]\naccuracy = other_package:share\n")
    with pytest.raises(ValueError, match="the name accuracy of other-package is taken"):
        plugins("repro.image_metrics", headings.METRICS)


@pytest.mark.parametrize("value", [1.0, [0.0, np.inf], [0.0]])
def test_a_metric_must_be_a_finite_number_for_each_image(monkeypatch, value):
    monkeypatch.setitem(image_metrics.IMAGE_METRICS, "own", lambda *_: value)
    with pytest.raises(ValueError, match="metric own: expected one finite number for each of 2 images"):
        image_metrics.of_images("own", *np.ones((2, 2, 1, 4, 4)))
