"""Is a simulated pose fit for use?"""
import numpy as np
from mathutils.bvhtree import BVHTree

from mesh import edges

# Intersecting pairs per triangle; in piles most are out of sight between layers.
INTERSECTIONS = {"flat": 0.01, "wrinkled": 0.01, "folded": 0.01, "crumpled": 0.02, "strip": 0.08, "stack": 0.02, "fold-2": 0.05, "fold-4": 0.13, "fold-s": 0.13}
STRETCH = 1.6  # edges against their rest length, 99th percentile
FOLDED_STRETCH = 1.85  # where outer layers turn round several inner ones
LONGEST = 4.0  # edge against the mean edge of the mesh
HEIGHT = {"flat": 0.06, "wrinkled": 0.16, "folded": 0.14, "crumpled": 0.30, "strip": 0.12, "stack": 0.30, "fold-2": 0.10, "fold-4": 0.12, "fold-s": 0.14}


def intersecting_pairs(p, faces):
    tree = BVHTree.FromPolygons([tuple(v) for v in p.tolist()], [tuple(f) for f in faces.tolist()])
    pairs = np.array(tree.overlap(tree), int).reshape(-1, 2)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    a, b = faces[pairs[:, 0]], faces[pairs[:, 1]]
    touching = (a[:, :, None] == b[:, None, :]).any((1, 2))
    return int((~touching).sum())


def settle(p):
    """Centre on the table and take away the gap that the simulation's thickness leaves below."""
    p = p.copy()
    p[:, :2] -= (p[:, :2].min(0) + p[:, :2].max(0)) / 2
    p[:, 2] -= p[:, 2].min() - 0.001
    return p


def wrinkledness(p, faces):
    """Mean angle in degrees between the vertical and the normals of faces seen from above.

    A face counts by its projected area if its centre is within 6 mm of the highest surface in its
    5 mm grid cell.
    """
    t = p[faces]
    n = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    size = np.maximum(np.linalg.norm(n, axis=1), 1e-12)
    centre = t.mean(1)
    cell = np.floor((centre[:, :2] - centre[:, :2].min(0)) / 0.01).astype(int)
    key = cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1]
    top = np.full(key.max() + 1, -np.inf)
    np.maximum.at(top, key, centre[:, 2])
    seen = centre[:, 2] > top[key] - 0.006
    cosine = np.abs(n[:, 2]) / size
    weight = np.abs(n[:, 2]) * seen
    return float(np.degrees(np.arccos(np.clip(cosine, 0, 1)) @ weight / max(weight.sum(), 1e-12)))


def measure(mesh, p):
    e = edges(mesh.faces)
    rest = np.linalg.norm(mesh.rest[e[:, 0]] - mesh.rest[e[:, 1]], axis=1)
    now = np.linalg.norm(p[e[:, 0]] - p[e[:, 1]], axis=1)
    ratio = now / np.maximum(rest, 1e-9)
    return {
        "vertices": len(p),
        "faces": len(mesh.faces),
        "edge_m": round(mesh.edge, 5),
        "intersecting_pairs": intersecting_pairs(p, mesh.faces),
        "height_m": round(float(p[:, 2].max()), 4),
        "stretch_p50": round(float(np.percentile(ratio, 50)), 3),
        "stretch_p99": round(float(np.percentile(ratio, 99)), 3),
        "longest_edge_m": round(float(now.max()), 4),
        "extent_m": np.round(np.ptp(p[:, :2], axis=0), 3).tolist(),
    }


def fault(raw, p, quality, state):
    """Why the pose must be rejected, None where it is good. raw: before settle()."""
    if (raw[:, 2] < -0.002).any():
        return "under the table"
    if np.linalg.norm(raw[:, :2], axis=1).max() > 1.8:
        return "slid off the table"
    if quality["intersecting_pairs"] > INTERSECTIONS[state] * quality["faces"]:
        return "intersections"
    most = FOLDED_STRETCH if state in ("strip", "fold-2", "fold-4", "fold-s") else STRETCH
    if quality["stretch_p99"] > most or quality["longest_edge_m"] > LONGEST * quality["edge_m"]:
        return "stretched"
    if quality["height_m"] > HEIGHT[state]:
        return "too high"
    return None
