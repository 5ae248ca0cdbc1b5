"""From panels to one sewn triangle mesh."""
import math
from dataclasses import dataclass

import numpy as np
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

import geometry as g


@dataclass
class Mesh:
    rest: np.ndarray  # [V,3] sewn garment lying flat, metres
    start: np.ndarray  # [V,3] the same with all layers clear of each other
    pattern: np.ndarray  # [V,2]
    faces: np.ndarray  # [F,3] counter-clockwise seen from outside
    panel: np.ndarray  # [F]
    stiff: np.ndarray  # [V] 0..1, share of the extra bending stiffness (bands, collars)
    edge: float  # mean edge length


def edge_length(garment, vertices):
    """Edge length at which the garment has about `vertices` vertices (triangular lattice)."""
    area = 0.0
    for panel in garment.panels:
        p = panel.outline()
        q = np.roll(p, -1, axis=0)
        area += abs(np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])) / 2
    return math.sqrt(area / vertices / 0.866)


def _boundary(segment, h):
    """Points about h apart; those of a strip's seam where the other panel has them."""
    if segment.along is None:
        return g.resample(segment.points, h)
    s = g.project(g.resample(segment.along, h), segment.along)
    return g.at(segment.points, s * g.length(segment.points) / g.length(segment.along))


def _triangulate(panel, h, rng):
    """(points, triangles, index of each boundary point per segment)."""
    loops = [_boundary(s, h) for s in panel.segments]
    boundary = np.concatenate([b[:-1] for b in loops])
    n = len(boundary)
    low, high = boundary.min(0), boundary.max(0)
    rows = np.arange(low[1], high[1], h * math.sqrt(3) / 2)
    lattice = [np.c_[np.arange(low[0] + (h / 2 if k % 2 else 0), high[0], h), np.full_like(np.arange(low[0] + (h / 2 if k % 2 else 0), high[0], h), y)] for k, y in enumerate(rows)]
    p = np.concatenate(lattice)
    p += rng.normal(0, h * 0.05, p.shape)
    closed = np.r_[boundary, boundary[:1]]
    p = p[g.inside(p, boundary) & (g.distance(p, closed) > h * 0.6)]
    q = np.r_[boundary, p]
    constraints = [(i, (i + 1) % n) for i in range(n)]
    _, _, faces, origin, _, _ = delaunay_2d_cdt([Vector(v) for v in q.tolist()], constraints, [], 1, 1e-6)
    if any(len(o) != 1 for o in origin):
        raise ValueError(f"panel {panel.name}: outline meets itself")
    # The triangulation is in single precision and in its own order: go back to our points.
    t = np.array([[origin[i][0] for i in f] for f in faces])
    t = t[g.inside(q[t].mean(1), boundary)]
    a, b, c = q[t[:, 0]], q[t[:, 1]], q[t[:, 2]]
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    t[area < 0] = t[area < 0][:, ::-1]
    starts = np.cumsum([0] + [len(b) - 1 for b in loops])
    ids = [np.arange(s, s + len(b)) % n for s, b in zip(starts[:-1], loops)]
    return q, t, ids


def _height(panel, p, h, gap, begin):
    """Resting place of a panel's points: layers apart, closing at the silhouette's seams."""
    if panel.ring is not None:
        out = panel.ring.at(p[:, 0], p[:, 1], begin) if panel.fold is None else panel.ring.leaf(p, gap, begin)
        out[:, 2] += 0.5 * gap
        return out
    silhouette = [s.points for s in panel.segments if s.silhouette]
    d = np.min([g.distance(p, s) for s in silhouette], axis=0) if silhouette else np.full(len(p), np.inf)
    closing = np.clip(d / (2 * h), 0, 1)
    out = np.c_[p, panel.level * gap * closing]
    if panel.fold is not None:
        # A collar's leaf: folded over at the neckline, it lies on the body and round its shoulder seam.
        away = np.clip(g.distance(p, panel.fold) / (1.5 * h), 0, 1)
        side = math.copysign(1.0, panel.level)
        out[:, 2] = (panel.level * gap + side * gap * away) * closing
        push = gap * (1 - closing) * away
        out[:, 0] += push * np.sign(p[:, 0]) * 0.3
        out[:, 1] += push
    return out


def build(garment, h, gap, rng):
    rest, start, pattern, faces, panel_of, stiff = [], [], [], [], [], []
    sewn, parent = {}, []

    def root(i):
        while parent[i] != i:
            i = parent[i]
        return i

    for index, panel in enumerate(garment.panels):
        p, t, ids = _triangulate(panel, h, rng)
        base = len(parent)
        parent.extend(range(base, base + len(p)))
        strip = panel.ring is not None and panel.fold is None
        rest.append(_height(panel, p, h, gap, False))
        start.append(_height(panel, p, h, gap, True))
        pattern.append(panel.ring.pattern(p) if strip else p)
        # A strip, laid out in pattern coordinates, is turned over.
        faces.append(base + (t if (panel.side == "front") != strip else t[:, ::-1]))
        panel_of.append(np.full(len(t), index, np.uint8))
        stiff.append(garment.stiffness(panel, p))
        for segment, which in zip(panel.segments, ids):
            if segment.seam is None:
                continue
            for i in which:
                x, y = pattern[-1][i]
                key = (segment.seam, round(x * 1e5), round(y * 1e5))
                if key in sewn:
                    a, b = sorted((root(sewn[key]), root(base + int(i))))
                    parent[b] = a
                else:
                    sewn[key] = base + int(i)
    roots = np.array([root(i) for i in range(len(parent))])
    kept, number = np.unique(roots, return_inverse=True)
    faces = number[np.concatenate(faces)]
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    if not whole.all():
        raise ValueError("a seam closed a triangle")
    stiff_all = np.zeros(len(kept))
    np.maximum.at(stiff_all, number, np.concatenate(stiff))
    return Mesh(np.concatenate(rest)[kept], np.concatenate(start)[kept], np.concatenate(pattern)[kept], faces, np.concatenate(panel_of), stiff_all, h)


def edges(faces):
    e = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return np.unique(e, axis=0)
