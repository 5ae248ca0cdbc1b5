"""Check a folder made by `weft synth states` with other means than those that made it. Run by Blender:

blender -b --factory-startup -P tools/synth/simulate/check_states.py -- DIR [--points N]

Meshes must be closed, oriented outwards, free of self-intersections, and the winding number of random
points must agree with the parity of ray crossings. The COCO files must agree with the label images, and
training and test must have no simulation in common. Prints a line for each fault; status 1 if there is one.
"""
import argparse
import json
import os
import sys

import numpy as np
from mathutils.bvhtree import BVHTree

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

import main

NEAR = 0.006  # half of the points lie within about this of the surface, metres


def read_obj(path):
    with open(path) as f:
        lines = f.read().split("\n")
    vertices = np.array([line[2:].split() for line in lines if line.startswith("v ")], float)
    faces = np.array([line[2:].split() for line in lines if line.startswith("f ")], int) - 1
    return vertices.reshape(-1, 3), faces.reshape(-1, 3)


def open_edges(faces):
    """Edges without exactly one face on each side, counting direction."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    n = int(faces.max()) + 1
    there, back = np.sort(edges[:, 0] * n + edges[:, 1]), np.sort(edges[:, 1] * n + edges[:, 0])
    if (np.diff(there) == 0).any() or len(there) != len(back):
        return int((np.diff(there) == 0).sum())
    return int((there != back).sum())


def component_volumes(vertices, faces):
    label = np.arange(len(vertices))
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    while True:
        low = np.minimum(label[ends[:, 0]], label[ends[:, 1]])
        new = label.copy()
        np.minimum.at(new, label[ends[:, 0]], low)
        np.minimum.at(new, label[ends[:, 1]], low)
        new = new[new]
        if (new == label).all():
            break
        label = new
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    _, number = np.unique(label[faces[:, 0]], return_inverse=True)
    return np.bincount(number, volume)


def intersecting_pairs(vertices, faces):
    tree = BVHTree.FromPolygons(vertices.tolist(), faces.tolist())
    pairs = np.array(tree.overlap(tree), int).reshape(-1, 2)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    touching = (faces[pairs[:, 0]][:, :, None] == faces[pairs[:, 1]][:, None, :]).any((1, 2))
    return int((~touching).sum())


def winding_number(vertices, faces, point):
    """By solid angles (Van Oosterom and Strackee 1983)."""
    d = vertices - point
    r = np.linalg.norm(d, axis=1)
    a, b, c = (d[faces[:, i]] for i in range(3))
    ra, rb, rc = (r[faces[:, i]] for i in range(3))
    dot = lambda x, y: np.einsum("ij,ij->i", x, y)
    over = dot(a, np.cross(b, c))
    under = ra * rb * rc + dot(a, b) * rc + dot(b, c) * ra + dot(c, a) * rb
    return float(np.arctan2(over, under).sum() / (2 * np.pi))


def crossings(vertices, faces, point, direction):
    """Faces that a ray meets: seen along it, the point lies in the projected triangle, ahead."""
    x = np.cross(direction, [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    d = vertices - point
    flat = np.c_[d @ x, d @ np.cross(direction, x), d @ direction]
    a, b, c = (flat[faces[:, i]] for i in range(3))
    cross = lambda p, q: p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    u, v, w = cross(b, c), cross(c, a), cross(a, b)
    hit = ((u > 0) & (v > 0) & (w > 0)) | ((u < 0) & (v < 0) & (w < 0))
    s = (u + v + w)[hit]
    return int(((u[hit] * a[hit, 2] + v[hit] * b[hit, 2] + w[hit] * c[hit, 2]) / s > 0).sum())


def mesh_faults(vertices, faces, points, rng):
    faults = []
    if len(faces) == 0 or not np.isfinite(vertices).all():
        return ["empty or not finite"]
    if open_edges(faces):
        return [f"{open_edges(faces)} edges are not of two faces that agree"]
    volumes = component_volumes(vertices, faces)
    if volumes.min() <= 0:
        faults.append(f"{(volumes <= 0).sum()} of {len(volumes)} pieces are inside out or hollows")
    pairs = intersecting_pairs(vertices, faces)
    if pairs:
        faults.append(f"{pairs} pairs of faces intersect")
    low, high = vertices.min(0), vertices.max(0)
    spread = rng.uniform(low - 0.05 * (high - low), high + 0.05 * (high - low), (points // 2, 3))
    near = vertices[rng.integers(len(vertices), size=points - points // 2)]
    near = near + rng.normal(0, NEAR, near.shape)
    for p in np.r_[spread, near]:
        winding = winding_number(vertices, faces, p)
        direction = rng.normal(size=3)
        parity = crossings(vertices, faces, p, direction / np.linalg.norm(direction)) % 2
        if abs(winding - parity) > 1e-6:
            faults.append(f"at {np.round(p, 4).tolist()} the winding number is {winding:.6f}, the parity of crossings {parity}")
    return faults


def decode_rle(counts, height, width):
    """Mask of COCO's compressed run lengths: columns first, starting with zeros."""
    runs, i = [], 0
    while i < len(counts):
        value, shift, more = 0, 0, True
        while more:
            code = ord(counts[i]) - 48
            value |= (code & 31) << shift
            more, shift, i = bool(code & 32), shift + 5, i + 1
            if not more and code & 16:
                value -= 1 << shift
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
    if sum(runs) != height * width or min(runs) < 0:
        raise ValueError("runs do not cover the picture")
    return np.repeat(np.arange(len(runs)) % 2 == 1, runs).reshape(width, height).T


def read_labels(path):
    import bpy

    image = bpy.data.images.load(path)
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return np.rint(pixels.reshape(height, width, 4)[::-1, :, 0] * 255).astype(np.uint8)


def coco_faults(coco, labels_of):
    """Faults of one COCO file; labels_of(file name): the label image."""
    faults = []
    names = {c["id"]: c["name"] for c in coco["categories"]}
    images = {i["id"]: i for i in coco["images"]}
    if len(images) != len(coco["images"]) or len({a["id"] for a in coco["annotations"]}) != len(coco["annotations"]):
        faults.append("identifiers are not unique")
    of_image = {i: [] for i in images}
    for a in coco["annotations"]:
        of_image[a["image_id"]].append(a)
    for i, annotations in of_image.items():
        labels = labels_of(images[i]["file_name"])
        left = set(np.unique(labels).tolist()) - {0} - {a["label"] for a in annotations}
        if any((labels == x).sum() >= 64 for x in left):
            faults.append(f"{images[i]['file_name']}: labels {sorted(left)} are not annotated")
        for a in annotations:
            where = f"{images[i]['file_name']}, annotation {a['id']}"
            mask = decode_rle(a["segmentation"]["counts"], *a["segmentation"]["size"])
            y, x = np.nonzero(labels == a["label"])
            box = [int(x.min()), int(y.min()), int(np.ptp(x)) + 1, int(np.ptp(y)) + 1] if len(x) else []
            if mask.shape != labels.shape or (mask != (labels == a["label"])).any():
                faults.append(f"{where}: the mask is not the label's")
            if a["area"] != len(x) or a["bbox"] != box:
                faults.append(f"{where}: area or box are wrong")
            if (names[a["category_id"]] == "desk") != (a["label"] == 255):
                faults.append(f"{where}: desk and its label do not agree")
    return faults


def check(folder, points):
    """Number of faults; says what was checked."""
    total, meshes, volumes = 0, 0, []

    def report(where, faults):
        nonlocal total
        total += len(faults)
        for fault in faults:
            print(f"{where}: {fault}", flush=True)

    for state in sorted(os.listdir(os.path.join(folder, "meshes"))):
        for name in sorted(os.listdir(os.path.join(folder, "meshes", state))):
            vertices, faces = read_obj(os.path.join(folder, "meshes", state, name))
            report(f"meshes/{state}/{name}", mesh_faults(vertices, faces, points, np.random.default_rng(meshes)))
            meshes += 1
    print(f"{meshes} meshes, {points} points each", flush=True)
    used, instances = {}, 0
    for split in ("train", "test"):
        path = os.path.join(folder, "annotations", f"instances_{split}.json")
        with open(path) as f:
            coco = json.load(f)
        report(path, coco_faults(coco, lambda file: read_labels(os.path.join(folder, "labels", file))))
        used[split] = {a["simulation"] for a in coco["annotations"] if a["label"] != 255}
        instances += len(coco["annotations"])
        kinds = {i["kind"] for i in coco["images"]}
        if split == "train" and "touching-same-colour" in kinds:
            report(path, ["T-shirts that touch in the same colour are for testing"])
    if used["train"] & used["test"]:
        report("annotations", [f"both for training and test: {sorted(used['train'] & used['test'])}"])
    print(f"{instances} instances; {len(used['train'])} simulations for training, {len(used['test'])} for testing; {total} faults", flush=True)
    return total


def start():
    parser = argparse.ArgumentParser(prog="check_states")
    parser.add_argument("folder")
    parser.add_argument("--points", type=int, default=64, help="random points of each mesh")
    args = parser.parse_args(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
    sys.exit(1 if check(args.folder, args.points) else 0)


if __name__ == "__main__":
    main.run(start)
