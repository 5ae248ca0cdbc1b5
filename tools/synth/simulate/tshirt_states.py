"""T-shirts in the six states of the garment SLAM paper (section 3.2), folded as cloth.

flat, strip (folded or gathered lengthwise), stack (picked up and dropped), fold-2 (in half across),
fold-4 (to a square: quartered or the shop's fold), fold-s (a strip folded once more across).

Folds are made in the frame of the body: origin in its middle, y towards the collar. Each fold rolls
what lies beyond a line over the rest and lets it settle as cloth before the next.
"""
import math
from dataclasses import dataclass, replace

import numpy as np

import geometry as g
import states
from cloth import FRAMES_PER_SECOND, simulate

STATES = ("flat", "strip", "stack", "fold-2", "fold-4", "fold-s")
# The paper's number of meshes of each state.
COUNTS = {"flat": 4, "strip": 12, "stack": 9, "fold-2": 4, "fold-4": 10, "fold-s": 5}
ROUND = tuple(s for s in STATES for _ in range(COUNTS[s]))
RADIUS = 0.006  # of the innermost layer at a fold, metres
PRESS = 6.0  # times gravity while a fold is smoothed down
CLEAR = 0.004  # between what is folded over and what it falls on, metres
UP, DOWN, RIGHT, LEFT = math.pi / 2, -math.pi / 2, 0.0, math.pi


@dataclass
class Fold:
    towards: float  # direction in which lies what is folded over, radians
    at: float  # distance of the line from the middle of the body in that direction, metres
    sleeves: bool = False  # only sleeves are folded
    with_next: bool = False  # settles together with the next fold, which it does not meet


def _mirrored(folds):
    return [replace(f, towards=LEFT - f.towards) if f.towards in (LEFT, RIGHT) else f for f in folds]


def _sleeves_in(w):
    return [Fold(RIGHT, w, True, True), Fold(LEFT, w, True)]


def _strip(way, w, long_sleeves, rng):
    """Folds that make a strip along the body. w: half the body's width."""
    if way == "thirds":
        at = w * rng.uniform(0.32, 0.42)
        return _sleeves_in(w * 0.97) + [Fold(RIGHT, at), Fold(LEFT, at + 0.012)]
    first = Fold(RIGHT, rng.uniform(-0.015, 0.015))
    if way == "half":
        tucked = [Fold(LEFT, w * 0.97, True)] if rng.random() < (1.0 if long_sleeves else 0.5) else []
        return [first] + tucked
    return _sleeves_in(w * 0.97) + [first, Fold(LEFT, w * rng.uniform(0.45, 0.55))]


def fold_plan(state, way, garment, rng):
    """Folds, in their order, that bring a garment laid flat into the state."""
    w = garment.cut["half_width"]
    long_sleeves = garment.family == "long-sleeve"
    if state == "strip":
        folds = _strip(way, w, long_sleeves, rng)
    elif state == "fold-s":
        folds = _strip(way, w, long_sleeves, rng) + [Fold(DOWN if rng.random() < 0.7 else UP, rng.uniform(-0.03, 0.05))]
    elif state == "fold-2":
        tucked = [Fold(side, w * rng.uniform(0.9, 1.0), True, True) for side in (RIGHT, LEFT) if rng.random() < 0.3]
        folds = tucked + [Fold(DOWN if rng.random() < 0.6 else UP, rng.uniform(-0.04, 0.05))]
    elif way == "quarter":
        tucked = _sleeves_in(w * 0.97) if long_sleeves or rng.random() < 0.3 else []
        folds = tucked + [Fold(DOWN if rng.random() < 0.6 else UP, rng.uniform(-0.02, 0.04)), Fold(RIGHT, rng.uniform(-0.015, 0.015))]
    else:
        at = w * rng.uniform(0.52, 0.64)
        folds = _sleeves_in(w * 0.97) + [Fold(RIGHT, at, with_next=True), Fold(LEFT, at)]
        folds.append(Fold(DOWN, rng.uniform(-0.01, 0.03)))
    return _mirrored(folds) if rng.random() < 0.5 else folds


def roll_over(p, mask, point, normal):
    """Roll what lies beyond the line through `point` over the rest.

    Layers keep half of the difference between their ways round the line: keeping all of it would
    shear the seams that join them, keeping none would stretch the outer ones.
    """
    s = (p[:, :2] - point) @ normal
    beyond = mask & (s > 0)
    if not beyond.any():
        return p
    near = mask & (np.abs(s) < 0.03)
    low, high = p[near, 2].min(), p[near, 2].max()
    axis_z = high + RADIUS
    r = axis_z - p[:, 2]
    turn = np.maximum(RADIUS, (r + axis_z - (low + high) / 2) / 2)
    theta = s / turn
    bend = beyond & (theta < math.pi)
    over = beyond & (theta >= math.pi)
    back = s - math.pi * turn
    new_s = np.where(bend, r * np.sin(theta), np.where(over, -back, s))
    q = p.copy()
    q[:, :2] += (new_s - s)[:, None] * normal
    q[:, 2] = np.where(bend, axis_z - r * np.cos(theta), np.where(over, axis_z + r, p[:, 2]))
    if over.any():
        # What lies higher elsewhere, like a folded sleeve, must be cleared.
        lift = p[~beyond, 2].max() + CLEAR - q[over, 2].min()
        q[over, 2] += max(0.0, lift) * np.clip(back[over] / 0.08, 0, 1)
    return q


def apply(fold, p, mesh, garment, skew=0.0):
    """Positions after rolling what the fold takes over the rest. skew: error of the line, radians."""
    normal = states._direction(fold.towards + skew)
    point = states._direction(fold.towards) * fold.at
    mask = np.ones(len(p), bool)
    if fold.sleeves:
        # Of the limbs on that side; laid face down, the left sleeve lies to the other side.
        mask = np.zeros(len(p), bool)
        for limb in garment.limbs:
            mask |= g.inside(mesh.pattern, limb.mask)
        mask &= (p[:, :2] - point) @ normal > 0
        if not mask.any():
            return p
    return roll_over(p, mask, point, normal)


def _body_frame(mesh, garment, rng, turned_over, limb_angle, uneven):
    p = states._turn_limbs(mesh.rest, mesh, garment, rng, limb_angle)
    p[:, 1] -= garment.cut["length"] / 2
    if turned_over:
        p = p * [-1, 1, -1]
    p[:, 2] += uneven * states._noise(p[:, :2], rng, 0.2)
    p = states._ripple(states._skew(p, rng, rng.uniform(0.0, 0.006)), rng, rng.uniform(0.0, 0.008))
    return states._rest_on(p, 0.008)


def _folded(mesh, garment, p, fabric, folds, rng):
    careful = rng.random() < 0.6
    p = simulate(mesh, p, fabric, 6, still=states.STILL, press=PRESS)
    for fold in folds:
        p = apply(fold, p, mesh, garment, rng.normal(0, 0.015 if careful else 0.05))
        if not fold.with_next:
            p = simulate(mesh, states._rest_on(p, 0.006), fabric, 7, still=states.STILL, press=PRESS)
    if rng.random() < 0.45:
        p = p * [-1, 1, -1]
    return simulate(mesh, states._rest_on(p, 0.006), fabric, 14, still=states.STILL)


def _grips(mesh, p, rng, points):
    """Vertices held by one or two hands, of one layer or of both."""
    pins = states._grip(mesh, p, rng, 1 if rng.random() < 0.5 else 2)
    if points == 1:
        return pins
    d = np.linalg.norm(p[:, :2] - p[pins[0], :2], axis=1)
    far = np.flatnonzero((d > 0.1) & (d < 0.35))
    second = far[int(rng.integers(len(far)))]
    near = np.argsort(np.linalg.norm(p[:, :2] - p[second, :2], axis=1), kind="stable")[:6]
    return np.unique(np.r_[pins, near])


def _stacked(mesh, p, fabric, rng):
    points = 1 if rng.random() < 0.6 else 2
    pins = _grips(mesh, p, rng, points)
    p = simulate(mesh, p, fabric, 22, pins=pins, table=False)
    p[:, :2] -= p[pins, :2].mean(0)
    p = states._rest_on(p, 0.01)
    down = rng.uniform(0.05, 0.14) - p[pins, 2].mean()
    frames = max(8, int(-down / rng.uniform(0.6, 1.0) * FRAMES_PER_SECOND))
    drift = rng.normal(0, 0.05, 2)
    p = simulate(mesh, p, fabric, frames, pins=pins, path=[(1, (0, 0, 0)), (frames + 1, (drift[0], drift[1], down))])
    return simulate(mesh, p, fabric, 18, still=states.STILL), ("one-hand", "two-hands")[points - 1]


def _dragged(mesh, garment, p, fabric, rng):
    """Held at the collar or both shoulders brought together, lowered hem first and laid out."""
    neck, length = garment.cut["neck_half_width"], garment.cut["length"]
    x = neck * rng.uniform(0.2, 1.0) if rng.random() < 0.5 else 1.4 * neck
    gather = rng.uniform(0.65, 0.78)
    # Both hands come together before they lift: the cloth between them goes into waves.
    wave = rng.uniform(0.07, 0.1)
    p = p.copy()
    p[:, 2] += wave / math.pi * math.sqrt(gather) * np.sin(2 * math.pi * p[:, 0] / wave + rng.uniform(0, 6))
    top = p[:, 1].max()
    pins = []
    for side in (-1, 1):
        d = np.linalg.norm(p[:, :2] - [side * x, length / 2 - 0.03], axis=1)
        pins.append(np.argsort(d, kind="stable")[:8])
    p[:, 0] *= 1 - gather
    pins = np.unique(np.concatenate(pins))
    # The garment hangs: stand it up before gravity does it with a swing.
    p = np.c_[p[:, 0], -p[:, 2], p[:, 1] - top]
    p = simulate(mesh, p, fabric, 14, pins=pins, table=False)
    p = states._rest_on(p, 0.01)
    height = p[pins, 2].mean()
    low = rng.uniform(0.02, 0.035)
    way = (height - low) * rng.uniform(1.0, 1.15)
    a = rng.choice([-1, 1]) * UP + rng.normal(0, 0.1)
    fall = int(height / 0.9 * FRAMES_PER_SECOND)
    pull = int(rng.uniform(0.04, 0.12) / 0.5 * FRAMES_PER_SECOND)
    step = way * states._direction(a)
    more = (way + pull * 0.5 / FRAMES_PER_SECOND) * states._direction(a)
    path = [(1, (0, 0, 0)), (fall, (step[0], step[1], low - height)), (fall + pull + 1, (more[0], more[1], low - height))]
    p = simulate(mesh, p, fabric, fall + pull, pins=pins, path=path)
    return simulate(mesh, p, fabric, 16, still=states.STILL)


WAYS = {
    "strip": ("thirds", "half", "quarter", "dragged"),
    "fold-2": ("half",),
    # Strips of three or four widths, and the shop's fold in three, lie in 12 and more layers once
    # folded across: at this mesh's spacing they always pierce each other.
    "fold-4": ("quarter", "shop-half"),
    "fold-s": ("half", "dragged"),
}


def lie(mesh, garment, fabric, state, turned_over, rng):
    """(positions, what was done)."""
    if state == "flat":
        p = _body_frame(mesh, garment, rng, turned_over, 0.35, rng.uniform(0.002, 0.005))
        p = states._ripple(states._skew(p, rng, rng.uniform(0.0, 0.01)), rng, rng.uniform(0.0, 0.02))
        how = "laid"
        if rng.random() < 0.5:
            # A corner of the hem or the end of a sleeve turned over.
            a = rng.choice([rng.uniform(-0.3, 0.3), -0.9 + rng.uniform(-0.4, 0.4)])
            a = a if rng.random() < 0.5 else math.pi - a
            reach = (p[:, :2] @ states._direction(a)).max()
            p = roll_over(p, np.ones(len(p), bool), states._direction(a) * (reach - rng.uniform(0.03, 0.09)), states._direction(a))
            how = "corner"
        return simulate(mesh, states._rest_on(p, 0.008), fabric, 22, still=states.STILL), how
    if state == "stack":
        p = _body_frame(mesh, garment, rng, turned_over, 0.4, 0.006)
        return _stacked(mesh, p, fabric, rng)
    way = str(rng.choice(WAYS[state]))
    if way == "dragged":
        p = _dragged(mesh, garment, _body_frame(mesh, garment, rng, turned_over, 0.1, 0.003), fabric, rng)
        if state == "strip":
            return p, way
        p[:, :2] -= (p[:, :2].min(0) + p[:, :2].max(0)) / 2
        return _folded(mesh, garment, p, fabric, [Fold(DOWN if rng.random() < 0.5 else UP, rng.uniform(-0.04, 0.04))], rng), way
    p = _body_frame(mesh, garment, rng, turned_over, 0.5 if state == "fold-2" else 0.2, rng.uniform(0.001, 0.003))
    return _folded(mesh, garment, p, fabric, fold_plan(state, way, garment, rng), rng), way
