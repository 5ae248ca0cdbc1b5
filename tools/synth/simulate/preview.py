"""Contact sheet of .wsim files, to look at. Run by Blender (for its numpy):

blender -b --factory-startup -P tools/synth/simulate/preview.py -- SHEET.png FILE.wsim ...

Seen from above, shaded; inside faces darker; parts tinted; stitches and other features drawn.
"""
import os
import struct
import sys
import zlib

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

import geometry as g
import wsim

PIXEL = 0.0022
SIDE = 440
TINTS = ((230, 90, 80), (80, 170, 90), (80, 120, 230))


def write_png(path, image):
    h, w, _ = image.shape
    rows = np.concatenate([np.zeros((h, 1), np.uint8), image.reshape(h, -1)], axis=1).tobytes()
    chunk = lambda t, d: struct.pack(">I", len(d)) + t + d + struct.pack(">I", zlib.crc32(t + d))
    with open(path, "wb") as f:
        f.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", w, h, 8, 2, 0, 0, 0)) + chunk(b"IDAT", zlib.compress(rows, 6)) + chunk(b"IEND", b""))


def _albedo(header, panel, xy, inside_face):
    colour = np.full((len(xy), 3), 190.0)
    colour[panel > 1] = (205, 200, 170)
    parts = sorted({p["part"] for p in header["parts"]})
    for i, q in enumerate(header["panels"]):
        here = np.flatnonzero(panel == i)
        if not len(here):
            continue
        p = xy[here]
        edge = lambda name: np.array(header["edges"][name][q["name"]])
        for part in header["parts"]:
            for region in part["regions"]:
                if region["panel"] != q["name"]:
                    continue
                m = g.inside(p, np.array(region["polygon"])) if "polygon" in region else g.distance(p, edge(region["edge"])) <= region["width_m"]
                colour[here[m]] = 0.5 * colour[here[m]] + 0.5 * np.array(TINTS[parts.index(part["part"]) % 3])
        for f in header["features"]:
            if f["panel"] != q["name"]:
                continue
            m = np.zeros(len(p), bool)
            if "polyline" in f:
                m = g.distance(p, np.array(f["polyline"])) < 0.0015
            elif "center" in f:
                m = np.linalg.norm(p - f["center"], axis=1) < f["radius_m"]
            elif "polygon" in f:
                m = g.inside(p, np.array(f["polygon"]))
                if f["kind"] != "label":
                    colour[here[m]] *= 0.9
                    m[:] = False
            if f["kind"] == "label":
                m &= inside_face[here] == (f.get("face") == "inside")
                colour[here[m]] = 255
            elif f["kind"] in ("button", "rivet", "cord"):
                colour[here[m]] = (250, 240, 60)
            else:
                colour[here[m]] = 30
    return colour


def picture(header, arrays):
    pose, pattern, faces, panel = (arrays[k] for k in ("pose", "pattern", "faces", "panel"))
    n = int(np.ceil(2.0 * header["quality"]["edge_m"] / PIXEL))
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
    keep = i + j <= n
    b = np.stack([i[keep], j[keep], n - i[keep] - j[keep]], axis=1) / n
    p = np.einsum("sk,fkc->fsc", b, pose[faces]).reshape(-1, 3)
    xy = np.einsum("sk,fkc->fsc", b, pattern[faces]).reshape(-1, 2)
    t = pose[faces].astype(float)
    normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    vertex = np.zeros(pose.shape)
    for k in range(3):
        np.add.at(vertex, faces[:, k], normal)
    smooth = np.einsum("sk,fkc->fsc", b, vertex[faces]).reshape(-1, 3)
    smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-12)
    column = np.floor(p[:, 0] / PIXEL + SIDE / 2).astype(int)
    row = np.floor(SIDE / 2 - p[:, 1] / PIXEL).astype(int)
    ok = (column >= 0) & (column < SIDE) & (row >= 0) & (row < SIDE)
    cell = row * SIDE + column
    top = np.full(SIDE * SIDE, -1.0)
    np.maximum.at(top, cell[ok], p[ok, 2])
    seen = np.flatnonzero(ok)[p[ok, 2] >= top[cell[ok]]]
    face = seen // len(b)
    down = normal[face, 2] < 0
    colour = _albedo(header, panel[face], xy[seen], down)
    s = smooth[seen] * np.where(smooth[seen, 2:] < 0, -1, 1)
    light = np.array([-0.55, 0.45, 0.7])
    shade = np.clip(s @ (light / np.linalg.norm(light)), 0.1, 1) * np.where(down, 0.65, 1.0)
    image = np.full((SIDE * SIDE, 3), 90.0)
    image[cell[seen]] = colour * shade[:, None]
    return np.clip(image, 0, 255).astype(np.uint8).reshape(SIDE, SIDE, 3)


def main():
    sheet, *files = sys.argv[sys.argv.index("--") + 1 :]
    pictures = [picture(*wsim.read(f)) for f in files]
    columns = min(6, len(pictures))
    pictures += [np.zeros_like(pictures[0])] * (-len(pictures) % columns)
    rows = [np.concatenate(pictures[i : i + columns], axis=1) for i in range(0, len(pictures), columns)]
    write_png(sheet, np.concatenate(rows, axis=0))


if __name__ == "__main__":
    main()
