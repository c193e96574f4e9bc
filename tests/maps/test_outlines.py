import numpy as np
import shapely
from shapely import affinity

from repro.maps.outlines import padded, placed

OUTLINES = np.array([[[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]], [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0]]])


def moved(outline: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Place an outline with shapely."""
    turned = affinity.rotate(shapely.LineString(outline), state[2], origin=(0, 0), use_radians=True)
    return shapely.get_coordinates(affinity.translate(turned, *state[:2]))


def test_outlines_are_placed_at_one_state_each():
    states = np.array([[3.0, -1.0, 0.7], [0.5, 8.0, -2.0]])
    found = placed(OUTLINES, states)
    expected = [moved(*pair) for pair in zip(OUTLINES, states, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_an_outline_is_placed_at_every_step():
    states = np.random.default_rng(0).normal(size=(5, 3))
    expected = [moved(OUTLINES[0], state) for state in states]
    np.testing.assert_allclose(placed(OUTLINES[0], states), expected, rtol=0, atol=1e-12)


def test_padding_repeats_the_last_vertex():
    wide = padded(OUTLINES, 9)
    assert np.array_equal(wide[:, : OUTLINES.shape[1]], OUTLINES)
    assert (wide[:, OUTLINES.shape[1] :] == OUTLINES[:, -1:]).all()
