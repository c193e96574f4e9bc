import numpy as np
import pytest
from PIL import Image

from repro.prediction import animation


def figures(directory, count: int) -> list:
    paths = [directory / f"window-{number}.png" for number in range(count)]
    for number, path in enumerate(paths):
        shade = round(255 * number / max(count - 1, 1))
        Image.fromarray(np.full((90, 180, 3), shade, dtype=np.uint8)).save(path)
    return paths


@pytest.mark.parametrize(("count", "frames"), [(1, 1), (7, 7), (30, 20)])
def test_the_frames_are_the_figures_in_order(tmp_path, monkeypatch, count, frames):
    monkeypatch.setattr(animation, "MAX_FRAMES", 20)
    assert animation.write_animation(tmp_path / "a.gif", figures(tmp_path, count)) == frames
    with Image.open(tmp_path / "a.gif") as found:
        assert (found.n_frames, found.size) == (frames, (900, 450))
        durations = []
        for number in range(frames):
            found.seek(number)
            durations.append(found.info["duration"])
        assert durations == [100] * (frames - 1) + [1000]


def test_small_colored_marks_keep_their_color(tmp_path):
    image = np.full((100, 900, 3), 255, dtype=np.uint8)
    image[:, :300] = np.arange(100, dtype=np.uint8)[:, None, None] * 2
    image[40:44, 500:504] = (179, 38, 30)
    Image.fromarray(image).save(tmp_path / "a.png")
    animation.write_animation(tmp_path / "a.gif", [tmp_path / "a.png"])
    with Image.open(tmp_path / "a.gif") as found:
        assert np.abs(np.array(found.convert("RGB"))[42, 502].astype(int) - (179, 38, 30)).max() < 10
