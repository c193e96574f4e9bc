"""Sequential Monte Carlo with tempering: particles move from a prior to a posterior (Del Moral et al., JRSS B 2006)."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import bisect

Move = Callable[[np.ndarray, np.ndarray, float], None]
MOVES = 8  # of each particle after each resampling
SHARE = 0.5  # of the effective particles that an increase of the weight keeps


def temper(particles: np.ndarray, energy: np.ndarray, move: Move, rng: np.random.Generator) -> None:
    """Raise the weight of the likelihood from zero to one, resample and move the particles after each increase.

    Args:
        particles: drawn from the prior, (K, P); drawn from the posterior afterwards.
        energy: their negative log likelihoods, (K,); updated, too.
        move: moves particles with their energies in place, given the weight.
        rng: random generator.
    """
    weight = 0.0
    while weight < 1:
        step = increase(energy, 1 - weight)
        weight = min(1.0, weight + step)
        chosen = resample(np.exp(-step * (energy - energy.min())), rng)
        particles[:], energy[:] = particles[chosen], energy[chosen]
        for _ in range(MOVES):
            move(particles, energy, weight)


def increase(energy: np.ndarray, most: float) -> float:
    """Return the increase of the weight, at most `most`, that keeps a share of the effective particles."""
    above = energy - energy.min()

    def excess(step: float) -> float:
        weights = np.exp(-step * above)
        return float(weights.sum() ** 2 / np.square(weights).sum() / len(weights) - SHARE)

    return most if excess(most) >= 0 else float(bisect(excess, 0.0, most, xtol=1e-12))


def resample(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw indices in proportion to weights (K,) by systematic resampling, (K,)."""
    total = np.cumsum(weights / weights.sum())
    return np.minimum(np.searchsorted(total, (np.arange(len(weights)) + rng.random()) / len(weights)), len(weights) - 1)
