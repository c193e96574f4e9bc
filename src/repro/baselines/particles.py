"""Compiled particles: what one obstacle may be, given the beams that end on it and those that pass.

A particle is a disc or a rectangle with a path of the whole window, by the laws of the paper's worlds. Random moves
draw from its prior, uniform in every parameter if the path starts on the map, times the likelihood of the scans to the
power of a weight. Compiled functions call only those of their own file, see `system.compiled`.
"""

import math

import numpy as np

from repro.system.compiled import compiled

# the parameters of a particle: lengths [m], angles [rad], speed [m/s]; the radius is that of a disc of the same area,
# the path turns once at random, at step TURN, and at the zone in the middle by the bounces
IS_DISC, RADIUS, ASPECT, HEADING, X, Y, SPEED, BEARING, TURN, NEXT_BEARING, FIRST_BOUNCE, NEXT_BOUNCE = range(12)
PARAMETERS = 12
SIGMA_M = 0.1  # of the distance of a hit to the outline and of the length of a beam inside; the scans have no noise
EVERY = 2  # steps whose passing beams are used
FARTHEST_M = 1.0  # a beam that misses by more counts as one that misses by this, since it may be of another obstacle

Form = tuple[bool, float, float, float, float, float]  # see `shape`
Motion = tuple[float, float, float, float, int]  # see `path`


@compiled
def move(
    particles: np.ndarray,
    energy: np.ndarray,
    weight: float,
    bounds: np.ndarray,
    motion: Motion,
    hits: tuple[np.ndarray, np.ndarray],
    scans: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    rng: np.random.Generator,
) -> None:
    """Move every particle once, in place, so that the density prior * exp(-weight * energy) stays the same.

    Args:
        particles: (K, PARAMETERS).
        energy: their energies, see `energies`, (K,).
        weight: of the scans, above 0, at most 1.
        bounds: least and largest value of each parameter, (2, PARAMETERS).
        motion: see `path`.
        hits: see `energies`.
        scans: see `energies`.
        rng: random generator.
    """
    for index in range(len(particles)):
        proposed, log_ratio = _propose(particles, index, bounds, rng)
        if log_ratio == -math.inf or not starts_on_map(proposed, motion):
            continue
        most = energy[index] + (log_ratio - math.log(rng.random())) / weight
        new = _energy(proposed, motion, hits, scans, most)
        if new < most:
            particles[index], energy[index] = proposed, new


@compiled
def energies(
    particles: np.ndarray,
    motion: Motion,
    hits: tuple[np.ndarray, np.ndarray],
    scans: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> np.ndarray:
    """Return the negative log likelihoods of particles: hits lie on their outlines, beams do not pass through them.

    Args:
        particles: (K, PARAMETERS).
        motion: see `path`.
        hits: steps, (H,), and points x, y [m], (H, 2), of beams that ended on the obstacle.
        scans: ranges [m], (T, N), with the maximum range for a miss; beam angles [rad], (N,); x, y [m] and cosine and
            sine of the heading of the robot, (T, 4); directions of the beams, (T, N, 2).

    Returns:
        energies, (K,).
    """
    result = np.empty(len(particles))
    for index in range(len(particles)):
        result[index] = _energy(particles[index], motion, hits, scans, math.inf)
    return result


@compiled
def _propose(
    particles: np.ndarray, index: int, bounds: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Propose another particle for one of them; return it and the log of the ratio of the densities, -inf if invalid.

    One is drawn from the prior where the scans may say nothing, or a side of a rectangle is moved, or the difference
    of two other particles is added (ter Braak, Differential evolution Markov chain, Statistics and Computing 2006).
    """
    kind = rng.random()
    proposed = particles[index].copy()
    if kind < 0.2:
        drawn = TURN + rng.integers(0, PARAMETERS - TURN)
        proposed[drawn] = rng.uniform(bounds[0, drawn], bounds[1, drawn])
        return proposed, 0.0
    if kind < 0.45 and proposed[IS_DISC] == 0.0:
        return _move_side(proposed, bounds, rng)
    first, second = rng.integers(0, len(particles)), rng.integers(0, len(particles))
    if index in (first, second):
        return proposed, -math.inf
    share = 1.0 if rng.random() < 0.3 else rng.uniform(0.1, 1.0)  # of the parameters that change
    factor = 1.0 if rng.random() < 0.1 else rng.uniform(0.3, 1.2) * 1.19 / math.sqrt(max(1.0, 5 * share))
    for which in range(1, PARAMETERS):
        if rng.random() > share:
            continue
        span = bounds[1, which] - bounds[0, which]
        change = particles[first, which] - particles[second, which]
        is_angle = which in (HEADING, BEARING, NEXT_BEARING)
        if is_angle:
            change -= span * math.floor(change / span + 0.5)
        proposed[which] += factor * change + 1e-4 * span * rng.normal()
        if is_angle:
            proposed[which] -= span * math.floor((proposed[which] - bounds[0, which]) / span)
        elif not bounds[0, which] <= proposed[which] <= bounds[1, which]:
            return proposed, -math.inf
    return proposed, 0.0


@compiled
def _move_side(particle: np.ndarray, bounds: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Propose a rectangle of which one side is moved in or out, in place; return as `_propose`."""
    _, length, width, cos, sin, _ = shape(particle)
    before = math.log(particle[ASPECT] / particle[RADIUS])
    change, sign = 0.5 * rng.normal() * 10 ** rng.uniform(-2, 0.6), 1.0 if rng.random() < 0.5 else -1.0
    if rng.random() < 0.5:
        length += change
        particle[X] += sign * change * cos
        particle[Y] += sign * change * sin
    else:
        width += change
        particle[X] -= sign * change * sin
        particle[Y] += sign * change * cos
    if length <= 0 or width <= 0:
        return particle, -math.inf
    if width > length and bounds[0, ASPECT] >= 1:  # the same rectangle with its longer side first
        length, width = width, length
        particle[HEADING] += math.pi / 2 if particle[HEADING] < 0 else -math.pi / 2
    particle[ASPECT], particle[RADIUS] = length / width, math.sqrt(4 * length * width / math.pi)
    for which in (RADIUS, ASPECT, X, Y):
        if not bounds[0, which] <= particle[which] <= bounds[1, which]:
            return particle, -math.inf
    return particle, math.log(particle[ASPECT] / particle[RADIUS]) - before


@compiled
def shape(particle: np.ndarray) -> Form:
    """Return whether a particle is a disc, half its length and width, cosine and sine of its heading, and its radius.

    Lengths are in meters; the radius is that of the circle around the shape. A rectangle has the area of the disc with
    the radius of the particle.
    """
    radius = particle[RADIUS]
    if particle[IS_DISC] == 1.0:
        return True, radius, radius, 1.0, 0.0, radius
    width = 0.5 * math.sqrt(math.pi / particle[ASPECT]) * radius
    length = particle[ASPECT] * width
    return False, length, width, math.cos(particle[HEADING]), math.sin(particle[HEADING]), math.hypot(length, width)


@compiled
def starts_on_map(particle: np.ndarray, motion: Motion) -> bool:
    """Return whether the circle around a particle is on the map before the first step, see `path`."""
    step_s, center_x, center_y, _, reference = motion
    radius, way_m = shape(particle)[5], particle[SPEED] * step_s
    turned = max(0, reference + 1 - int(particle[TURN]))  # moves after the random turn
    straight = reference + 1 - turned
    x = particle[X] - way_m * (straight * math.cos(particle[BEARING]) + turned * math.cos(particle[NEXT_BEARING]))
    y = particle[Y] - way_m * (straight * math.sin(particle[BEARING]) + turned * math.sin(particle[NEXT_BEARING]))
    return radius <= x <= 2 * center_x - radius and radius <= y <= 2 * center_y - radius


@compiled
def path(particle: np.ndarray, motion: Motion, steps: int) -> np.ndarray:
    """Return the positions of a particle at every step [m], (T, 2), as `drift.Drift` moves it.

    Before the step of its x and y, turns at the zone are left out.

    Args:
        particle: (PARAMETERS,).
        motion: duration of a step [s], x and y of the center of the map [m], distance that the outline keeps from it
            [m], and the step at which the particle is at its x and y.
        steps: T.
    """
    step_s, center_x, center_y, clear_m, reference = motion
    keep_out_m = clear_m + shape(particle)[5]
    positions = np.empty((steps, 2))
    positions[reference] = particle[X], particle[Y]
    stride, turn = particle[SPEED] * step_s, int(particle[TURN])
    first = (stride * math.cos(particle[BEARING]), stride * math.sin(particle[BEARING]))
    second = (stride * math.cos(particle[NEXT_BEARING]), stride * math.sin(particle[NEXT_BEARING]))
    for step in range(reference, 0, -1):
        move_x, move_y = first if step < turn else second
        positions[step - 1, 0], positions[step - 1, 1] = positions[step, 0] - move_x, positions[step, 1] - move_y
    move_x, move_y = first if reference + 1 < turn else second
    bounces = 0
    for step in range(reference + 1, steps):
        if step == turn:
            move_x, move_y = second
        away_x, away_y = positions[step - 1, 0] - center_x, positions[step - 1, 1] - center_y
        if (away_x + move_x) ** 2 + (away_y + move_y) ** 2 < keep_out_m**2 and move_x * away_x + move_y * away_y < 0:
            bearing = math.atan2(away_y, away_x) + particle[FIRST_BOUNCE if bounces == 0 else NEXT_BOUNCE]
            bounces += 1
            move_x, move_y = stride * math.cos(bearing), stride * math.sin(bearing)
        positions[step, 0] = positions[step - 1, 0] + move_x
        positions[step, 1] = positions[step - 1, 1] + move_y
    return positions


@compiled
def distance(form: Form, position: np.ndarray, point: np.ndarray) -> float:
    """Return the distance of a point (2,) to the outline of a `shape` at a position (2,) [m]."""
    is_disc, length, width, cos, sin, _ = form
    x, y = point[0] - position[0], point[1] - position[1]
    if is_disc:
        return abs(math.sqrt(x * x + y * y) - length)
    beyond_x, beyond_y = abs(x * cos + y * sin) - length, abs(y * cos - x * sin) - width
    if beyond_x <= 0 and beyond_y <= 0:
        return -max(beyond_x, beyond_y)
    return math.hypot(max(beyond_x, 0.0), max(beyond_y, 0.0))


@compiled
def near(
    particles: np.ndarray,
    motion: Motion,
    hits: tuple[np.ndarray, np.ndarray],
    within_m: float,
    steps: int,
) -> np.ndarray:
    """Return the share of the particles whose outline is near each hit, (H,)."""
    when, points = hits
    share = np.zeros(len(when))
    for particle in particles:
        positions, form = path(particle, motion, steps), shape(particle)
        for index in range(len(when)):
            share[index] += distance(form, positions[when[index]], points[index]) <= within_m
    return share / len(particles)


@compiled
def _energy(
    particle: np.ndarray,
    motion: Motion,
    hits: tuple[np.ndarray, np.ndarray],
    scans: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    most: float,
) -> float:
    """Return the negative log likelihood of a particle: hits lie on its outline, and beams do not pass through it.

    The sum ends early, at some value above it, once it exceeds `most`.
    """
    ranges, angles, poses, directions = scans
    when, points = hits
    positions, form = path(particle, motion, len(ranges)), shape(particle)
    total, most = 0.0, most * 2 * SIGMA_M**2
    for index in range(len(when)):
        total += min(distance(form, positions[when[index]], points[index]), FARTHEST_M) ** 2
        if total > most:
            return total / (2 * SIGMA_M**2)
    radius, spacing = form[5], angles[1] - angles[0]
    cone_cos, cone_sin = math.cos(angles[-1]), math.sin(angles[-1])
    for step in range((len(ranges) - 1) % EVERY, len(ranges), EVERY):
        x, y = positions[step, 0] - poses[step, 0], positions[step, 1] - poses[step, 1]
        cos, sin = poses[step, 2], poses[step, 3]
        ahead, aside = x * cos + y * sin, y * cos - x * sin
        if abs(aside) * cone_cos - ahead * cone_sin > radius:
            continue  # outside the field of view
        apart = math.sqrt(x * x + y * y)
        bearing = math.atan2(aside, ahead)
        half = math.pi if apart <= radius else math.asin(radius / apart)
        first = max(0, math.ceil((bearing - half - angles[0]) / spacing))
        last = min(len(angles) - 1, math.floor((bearing + half - angles[0]) / spacing))
        for beam in range(first, last + 1):
            if ranges[step, beam] > apart - radius:
                inside = _inside(form, x, y, directions[step, beam, 0], directions[step, beam, 1], ranges[step, beam])
                total += min(inside, FARTHEST_M) ** 2
        if total > most:
            break
    return total / (2 * SIGMA_M**2)


@compiled
def _inside(form: Form, x: float, y: float, cos: float, sin: float, reach: float) -> float:
    """Return the length of a beam from the origin inside a shape at (x, y) [m]."""
    is_disc, length, width, turn_cos, turn_sin, _ = form
    if is_disc:
        along, side = x * cos + y * sin, y * cos - x * sin
        square = length**2 - side**2
        if square <= 0:
            return 0.0
        enters, leaves = along - math.sqrt(square), along + math.sqrt(square)
    else:
        own_x, own_y = -(x * turn_cos + y * turn_sin), -(y * turn_cos - x * turn_sin)
        own_cos, own_sin = cos * turn_cos + sin * turn_sin, sin * turn_cos - cos * turn_sin
        enters, leaves = -math.inf, math.inf
        for start, slope, half in ((own_x, own_cos, length), (own_y, own_sin, width)):
            inverse = 1.0 / (slope if abs(slope) > 1e-12 else 1e-12)
            near_end, far_end = (-half - start) * inverse, (half - start) * inverse
            enters, leaves = max(enters, min(near_end, far_end)), min(leaves, max(near_end, far_end))
    return max(0.0, min(leaves, reach) - max(enters, 0.0))
