"""Planar geometry on polylines: arrays of shape [N,2], metres."""
import math

import numpy as np


def points(*pairs):
    return np.array(pairs, float)


def mirror(polyline):
    """The polyline mirrored in x and reversed, so that an outline can go on with it."""
    return polyline[::-1] * [-1.0, 1.0]


def bezier(p0, p1, p2, p3, n=24):
    t = np.linspace(0.0, 1.0, n)[:, None]
    p0, p1, p2, p3 = (np.asarray(p, float) for p in (p0, p1, p2, p3))
    return (1 - t) ** 3 * p0 + 3 * (1 - t) ** 2 * t * p1 + 3 * (1 - t) * t**2 * p2 + t**3 * p3


def length(polyline):
    return float(np.linalg.norm(np.diff(polyline, axis=0), axis=1).sum())


def at(polyline, s):
    """Points at arc lengths s."""
    d = np.r_[0, np.cumsum(np.linalg.norm(np.diff(polyline, axis=0), axis=1))]
    return np.c_[np.interp(s, d, polyline[:, 0]), np.interp(s, d, polyline[:, 1])]


def resample(polyline, step, corner_degrees=20.0):
    """Points about `step` apart; corners sharper than corner_degrees stay where they are."""
    d = np.diff(polyline, axis=0)
    a = np.arctan2(d[:, 1], d[:, 0])
    turn = np.abs((np.diff(a) + math.pi) % (2 * math.pi) - math.pi)
    corners = [0, *(np.flatnonzero(turn > math.radians(corner_degrees)) + 1), len(polyline) - 1]
    out = [polyline[:1]]
    for i, j in zip(corners[:-1], corners[1:]):
        run = polyline[i : j + 1]
        total = length(run)
        n = max(1, int(round(total / step)))
        out.append(at(run, np.linspace(0, total, n + 1)[1:]))
        out[-1][-1] = polyline[j]
    return np.concatenate(out)


def distance(p, polyline):
    """Distance of each point of p to the polyline."""
    best = np.full(len(p), np.inf)
    for a, b in zip(polyline[:-1], polyline[1:]):
        ab = b - a
        t = np.clip((p - a) @ ab / max(ab @ ab, 1e-12), 0, 1)
        best = np.minimum(best, np.linalg.norm(p - a - t[:, None] * ab, axis=1))
    return best


def project(p, polyline):
    """Arc length at which each point of p is nearest to the polyline."""
    best, where, start = np.full(len(p), np.inf), np.zeros(len(p)), 0.0
    for a, b in zip(polyline[:-1], polyline[1:]):
        ab = b - a
        t = np.clip((p - a) @ ab / max(ab @ ab, 1e-12), 0, 1)
        d = np.linalg.norm(p - a - t[:, None] * ab, axis=1)
        where = np.where(d < best, start + t * np.linalg.norm(ab), where)
        best = np.minimum(best, d)
        start += np.linalg.norm(ab)
    return where


def inside(p, polygon):
    """Even-odd rule."""
    x, y = p[:, 0], p[:, 1]
    result = np.zeros(len(p), bool)
    for (xi, yi), (xj, yj) in zip(polygon, np.roll(polygon, 1, axis=0)):
        if yi == yj:
            continue
        crosses = (yi > y) != (yj > y)
        result ^= crosses & (x < (xj - xi) * (y - yi) / (yj - yi) + xi)
    return result


def offset(polyline, d):
    """The polyline moved by d to its left (vertex normals; good for gentle curves)."""
    t = np.gradient(polyline, axis=0)
    t /= np.maximum(np.linalg.norm(t, axis=1, keepdims=True), 1e-12)
    return polyline + d * np.c_[-t[:, 1], t[:, 0]]


def grow(polygon, d):
    """Push each vertex away from the centroid by d: enough for masks with a margin."""
    c = polygon.mean(0)
    v = polygon - c
    return polygon + d * v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12)


def rectangle(cx, cy, w, h):
    return points((cx - w / 2, cy - h / 2), (cx + w / 2, cy - h / 2), (cx + w / 2, cy + h / 2), (cx - w / 2, cy + h / 2))
