"""Figures of maps: unknown pixels never look like free ones."""

from dataclasses import replace

import numpy as np
import pytest

import repro
from repro.maps.grid import Grid
from repro.prediction.drawing import TINT, draw_map, draw_window, shade
from repro.prediction.stream_map import StreamMap
from repro.prediction.windows import Window
from repro.scans import Scans

GRID, ORIGIN = Grid(100, 50.0), (-3.0, 7.0)


def window() -> Window:
    scans = Scans(np.full((1, 3), 5.0), np.array([-0.1, 0, 0.1]), np.array([[25.0, 25.0, 0.0]]))
    return Window(1, 12.5, scans, ORIGIN, None)


def predicted(free: np.ndarray) -> StreamMap:
    """Return a map whose upper half is unknown, with something that moves in the first pixel of row 60."""
    unknown, moving = (np.zeros(free.shape, bool) for _ in range(2))
    unknown[:50], moving[60, 0] = True, True
    return StreamMap(free, ORIGIN, 0.5, 12.5, unknown, moving, np.array([[27.0, 32.0]]), (22.0, 32.0, 0.0))


def labels(figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_free_pixel_is_white_an_unknown_one_tinted_and_an_obstacle_dark_in_both():
    free = np.array([[1.0, 1.0], [0.0, 0.0], [0.5, 0.5]])
    image = shade(free, np.array([[False, True]] * 3))
    assert np.array_equal(image[:, 0], np.repeat(free[:, :1], 3, axis=1))
    assert image[:, 1] == pytest.approx(free[:, 1:] * TINT)
    assert np.abs(image[0, 0] - image[0, 1]).max() > 0.2


def test_a_map_is_drawn_in_one_call_where_it_lies(tmp_path):
    free = np.full((100, 100), 0.75)
    figure = repro.draw_map(predicted(free))
    axes = figure.axes[0]
    assert np.array_equal(axes.images[0].get_array(), shade(free, predicted(free).unknown))
    assert axes.images[0].get_extent() == [-3, 47, 7, 57]
    lines = {line.get_label(): np.squeeze(line.get_xydata()) for line in axes.lines}
    assert lines["newest hits"] == pytest.approx((27, 32))
    assert lines["robot, its heading"] == pytest.approx((22, 32))
    assert lines["hits on what moves"] == pytest.approx((-2.75, 26.75))  # the middle of the pixel
    assert labels(figure) == ["hits on what moves", "newest hits", "robot, its heading", "no beam has been there"]
    assert figure.axes[1].get_ylabel() == "probability of free"
    figure.savefig(tmp_path / "map.png")
    nothing = replace(predicted(free), moving=np.zeros((100, 100), bool))
    assert "hits on what moves" not in labels(draw_map(nothing))


def test_the_figure_of_a_window_shows_hits_map_and_what_other_scans_show():
    first, free = window(), np.full((100, 100), 0.25)
    pose = first.scans.poses
    following = Scans(np.array([[4.0, 6.0, np.inf]]), first.scans.angles, pose)
    held_out = Scans(np.array([[np.nan, 4.0, 6.0, np.inf]]), np.array([0.0, 0.5, 1.0, 1.5]), pose)
    figure = draw_window(replace(first, following=following, held_out=held_out), predicted(free), GRID, 30.0, "2.5 s")
    hits, ours, truth = (ax.images[0].get_array() for ax in figure.axes[:3])
    assert ((hits == 0).all(-1)).sum() == 3  # one for each beam
    assert np.array_equal(ours, shade(free, predicted(free).unknown))
    assert ((truth == 0).all(-1)).sum() == 4
    assert {tuple(color) for color in truth.reshape(-1, 3)} == {(0, 0, 0), (1, 1, 1), TINT}
    lines = {line.get_label(): len(line.get_xdata()) for line in figure.axes[2].lines}
    assert lines == {"hits of the next scan": 2, "held-out hits": 2}
    titles = [ax.get_title() for ax in figure.axes[:3]]
    assert titles[1:] == ["predicted map at 2.5 s", "truth: next scan and held-out beams"]
    assert "path of the robot" in labels(figure)
    assert draw_window(first, predicted(free), GRID, 30.0, "0 s").axes[2].get_title() == "truth: none"
