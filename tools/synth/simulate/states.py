"""How a garment comes to lie on the table: flat, wrinkled, folded or crumpled."""
import math

import numpy as np

import geometry as g
from cloth import FRAMES_PER_SECOND, simulate

STATES = ("flat", "wrinkled", "folded", "crumpled")
SHARES = (0.30, 0.25, 0.25, 0.20)
STILL = 0.0005  # mean step per frame at which the cloth counts as settled, metres


def _noise(xy, rng, wave, waves=6):
    """Smooth random function of the plane, about unit variance."""
    z = np.zeros(len(xy))
    for _ in range(waves):
        k = rng.normal(size=2)
        k *= 2 * math.pi / (wave * rng.uniform(0.6, 1.6)) / np.linalg.norm(k)
        z += np.sin(xy @ k + rng.uniform(0, 2 * math.pi))
    return z * math.sqrt(2 / waves)


def _turn_limbs(p, mesh, garment, rng, most):
    """Sleeves and legs turned at their root and bent halfway, in the plane."""
    p = p.copy()
    for limb in garment.limbs:
        mask = g.inside(mesh.pattern, limb.mask)
        outward = math.copysign(1.0, limb.pivot[0])
        root = rng.uniform(-min(most, limb.inward), most * limb.loose)
        bends = [(limb.pivot, outward * root)]
        if limb.length > 0.4:
            elbow = limb.pivot + limb.axis * limb.length * rng.uniform(0.4, 0.6)
            bends.insert(0, (elbow, outward * rng.uniform(-min(most, limb.inward + root), most)))
        for pivot, angle in bends:
            s = (mesh.pattern - pivot) @ limb.axis
            t = np.clip(s / 0.12 + 0.5, 0, 1)
            a = angle * t * t * (3 - 2 * t) * mask
            d = p[:, :2] - pivot
            p[:, 0] = pivot[0] + d[:, 0] * np.cos(a) - d[:, 1] * np.sin(a)
            p[:, 1] = pivot[1] + d[:, 0] * np.sin(a) + d[:, 1] * np.cos(a)
    return p


def _lay(mesh, garment, rng, turned_over, limb_angle, uneven, upright=1.0):
    """The garment laid out over the table; upright: of a standing collar's height at the beginning."""
    p = _turn_limbs(mesh.start, mesh, garment, rng, limb_angle)
    p[:, 2] -= (1 - upright) * np.maximum(0, p[:, 2] - 0.015)
    p[:, :2] -= (p[:, :2].min(0) + p[:, :2].max(0)) / 2
    if turned_over:
        p = p * [-1, 1, -1]
    p[:, 2] += uneven * _noise(p[:, :2], rng, 0.2)
    return _rest_on(p, 0.008)


def _rest_on(p, z):
    p = p.copy()
    p[:, 2] += z - p[:, 2].min()
    return p


def _skew(p, rng, amount):
    """Nothing is ever laid out straight: smooth displacements in the plane."""
    q = p.copy()
    wave = rng.uniform(0.5, 0.9)
    for axis in (0, 1):
        q[:, axis] += amount * _noise(p[:, :2], rng, wave)
    return q


def _ripple(p, rng, squeeze):
    """Push the cloth together along one direction into waves of about the same length of cloth."""
    d = _direction(rng.uniform(0, 2 * math.pi))
    wave = rng.uniform(0.08, 0.22)
    xy = p[:, :2]
    phase = 2 * math.pi * (xy @ d) / wave + 1.5 * _noise(xy, rng, 2.5 * wave)
    strength = np.clip(0.6 + 0.5 * _noise(xy, rng, 0.4), 0, 1.1)
    q = p.copy()
    q[:, :2] -= squeeze * (xy @ d)[:, None] * d
    # A sine of amplitude a shortens its wave by the share (pi a / wave)^2.
    q[:, 2] += strength * wave / math.pi * math.sqrt(squeeze) * np.sin(phase)
    return q


def _fold(p, mask, point, normal, radius):
    """Roll what lies beyond the line through `point` over the rest; the middle layer keeps its length."""
    s = (p[:, :2] - point) @ normal
    low, high = p[mask, 2].min(), p[mask, 2].max()
    axis_z = high + radius
    turn = axis_z - (low + high) / 2
    r = axis_z - p[:, 2]
    theta = s / turn
    bend = mask & (s > 0) & (theta < math.pi)
    over = mask & (theta >= math.pi)
    new_s = np.where(bend, r * np.sin(theta), np.where(over, -(s - math.pi * turn), s))
    q = p.copy()
    q[:, :2] += (new_s - s)[:, None] * normal
    q[:, 2] = np.where(bend, axis_z - r * np.cos(theta), np.where(over, axis_z + r, p[:, 2]))
    return q


def _direction(a):
    return np.array([math.cos(a), math.sin(a)])


def _folded(mesh, garment, p, rng):
    """One or two folds a person might make: in half, a corner, a sleeve or a leg."""
    everything = np.ones(len(p), bool)
    long_limbs = [l for l in garment.limbs if l.length > 0.2]
    kinds = ["half-side", "half-length", "diagonal", "corner"] + ["limb"] * (2 if long_limbs else 0)
    count = 1 if rng.random() < 0.65 else 2
    names = []
    for kind in rng.choice(kinds, count, replace=False):
        low, high = p[:, :2].min(0), p[:, :2].max(0)
        middle, extent = (low + high) / 2, high - low
        sign = rng.choice([-1, 1])
        mask = everything
        if kind == "limb":
            limb = long_limbs[int(rng.integers(len(long_limbs)))]
            mask = g.inside(mesh.pattern, limb.mask) & ((mesh.pattern - limb.pivot) @ limb.axis > 0.03)
            if not mask.any():
                continue
            t = limb.length * rng.uniform(0.12, 0.6)
            s = (mesh.pattern - limb.pivot) @ limb.axis
            near = mask & (np.abs(s - t) < 0.03)
            root = mask & (s < t)
            point = p[near, :2].mean(0)
            normal = point - p[root, :2].mean(0)
            normal = normal / np.linalg.norm(normal)
            a = math.atan2(normal[1], normal[0]) + rng.uniform(-0.5, 0.5)
        elif kind == "corner":
            a = rng.uniform(0, 2 * math.pi)
            reach = ((p[:, :2] - middle) @ _direction(a)).max()
            point = middle + _direction(a) * reach * rng.uniform(0.45, 0.8)
        else:
            a = {"half-side": 0.0, "half-length": math.pi / 2, "diagonal": rng.uniform(0.4, 1.2)}[kind] + (math.pi if sign < 0 else 0)
            a += rng.normal(0, 0.08)
            point = middle + _direction(a) * extent.min() * rng.uniform(-0.08, 0.25)
        p = _fold(p, mask, point, _direction(a), 0.012)
        names.append(str(kind))
    return p, "+".join(names)


def _grip(mesh, p, rng, layers):
    """Vertices between two fingers: nearest to one vertex, of one layer or of all."""
    i = int(rng.integers(len(p)))
    d = np.linalg.norm(p[:, :2] - p[i, :2], axis=1)
    if layers == 1:
        d += 10 * np.abs(mesh.rest[:, 2] - mesh.rest[i, 2])
    return np.argsort(d, kind="stable")[: 4 * layers]


def _pick_and_drop(mesh, p, fabric, rng, height, way):
    """Lift at one grip, carry towards the middle and let go."""
    pins = _grip(mesh, p, rng, 1 if rng.random() < 0.5 else 2)
    towards = p[:, :2].mean(0) - p[pins, :2].mean(0)
    a = math.atan2(towards[1], towards[0]) + rng.normal(0, 0.6)
    step = way * _direction(a)
    frames = max(8, int(math.hypot(height, way) / 1.1 * FRAMES_PER_SECOND))
    up = max(3, frames // 2)
    path = [(1, (0, 0, 0)), (up, (0.35 * step[0], 0.35 * step[1], height)), (frames + 1, (step[0], step[1], 0.6 * height))]
    p = simulate(mesh, p, fabric, frames, pins=pins, path=path)
    return simulate(mesh, p, fabric, 26, still=STILL)


def _drag(mesh, p, fabric, rng):
    """Take hold of the garment here and there, through all layers, and shift it over the table: it stays
    spread out and wrinkles towards the grips."""
    for _ in range(int(rng.integers(1, 4))):
        pins = _grip(mesh, p, rng, 2)
        towards = p[:, :2].mean(0) - p[pins, :2].mean(0)
        a = math.atan2(towards[1], towards[0]) + rng.normal(0, 0.9)
        step = rng.uniform(0.04, 0.16) * _direction(a)
        lift = rng.uniform(0.005, 0.04)
        frames = max(6, int(np.linalg.norm(step) / 0.5 * FRAMES_PER_SECOND))
        path = [(1, (0, 0, 0)), (3, (0.1 * step[0], 0.1 * step[1], lift)), (frames + 1, (step[0], step[1], 0.5 * lift))]
        p = simulate(mesh, p, fabric, frames, pins=pins, path=path)
    return simulate(mesh, p, fabric, 22, still=STILL)


def _hang_and_drop(mesh, p, fabric, rng):
    """Hang from one grip, lower on to the table, let go."""
    pins = _grip(mesh, p, rng, 1)
    p = simulate(mesh, p, fabric, 22, pins=pins, table=False)
    p[:, :2] -= p[pins, :2].mean(0)
    p = _rest_on(p, 0.01)
    down = rng.uniform(0.06, 0.16) - p[pins, 2].mean()
    frames = max(8, int(-down / rng.uniform(0.6, 1.0) * FRAMES_PER_SECOND))
    drift = rng.normal(0, 0.05, 2)
    p = simulate(mesh, p, fabric, frames, pins=pins, path=[(1, (0, 0, 0)), (frames + 1, (drift[0], drift[1], down))])
    return simulate(mesh, p, fabric, 18, still=STILL)


def lie(mesh, garment, fabric, state, turned_over, rng):
    """(positions, what was done)."""
    if state == "flat":
        p = _lay(mesh, garment, rng, turned_over, 0.25, rng.uniform(0.002, 0.006))
        p = _skew(p, rng, rng.uniform(0.0, 0.012))
        p = _rest_on(_ripple(p, rng, rng.uniform(0.0, 0.03)), 0.008)
        return simulate(mesh, p, fabric, 20, still=STILL), "laid"
    if state == "wrinkled":
        p = _lay(mesh, garment, rng, turned_over, 0.45, rng.uniform(0.003, 0.008))
        p = _skew(p, rng, rng.uniform(0.004, 0.022))
        way = rng.random()
        if way < 0.45:
            p = _rest_on(_ripple(p, rng, rng.uniform(0.0, 0.05)), 0.008)
            return _drag(mesh, p, fabric, rng), "dragged"
        waves = int(rng.integers(1, 4))
        for _ in range(waves):
            p = _ripple(p, rng, rng.uniform(0.05, 0.2) / math.sqrt(waves))
        p = _rest_on(p, 0.008)
        if way < 0.7:
            return simulate(mesh, p, fabric, 26, still=STILL), "rippled"
        return _pick_and_drop(mesh, p, fabric, rng, rng.uniform(0.08, 0.25), rng.uniform(0.1, 0.35)), "picked"
    if state == "folded":
        p = _lay(mesh, garment, rng, turned_over, 0.3, rng.uniform(0.001, 0.003), 0.4)
        p = _ripple(_skew(p, rng, rng.uniform(0.0, 0.01)), rng, rng.uniform(0.0, 0.01))
        p, how = _folded(mesh, garment, p, rng)
        return simulate(mesh, _rest_on(p, 0.008), fabric, 26, still=STILL), how
    p = _lay(mesh, garment, rng, turned_over, 0.4, 0.006)
    if rng.random() < 0.4:
        return _pick_and_drop(mesh, p, fabric, rng, rng.uniform(0.22, 0.42), rng.uniform(0.1, 0.35)), "lifted"
    return _hang_and_drop(mesh, p, fabric, rng), "hung"
