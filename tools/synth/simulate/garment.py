"""A garment: panels in pattern coordinates, what is sewn to what, its parts and what is drawn on it.

Pattern coordinates: x right, y up, metres, garment as worn and seen from the front (back panels use
the same x and y); the wearer's left is +x. Edges, parts and features are those of
docs/simulation-format.md.
"""
import math
from dataclasses import dataclass, field

import numpy as np

import geometry as g


@dataclass
class Segment:
    points: np.ndarray
    edge: str | None = None  # name under which the polyline is published
    seam: str | None = None  # segments of one seam name share the vertices that coincide
    silhouette: bool = False  # front and back meet here
    along: np.ndarray | None = None  # of a strip: the edge's pattern coordinates


@dataclass
class Panel:
    name: str
    side: str  # "front" | "back"
    layer: int
    level: float  # resting height in units of the distance between front and back
    segments: list
    fold: np.ndarray | None = None  # line at which the panel is folded over another one
    ring: "Ring | None" = None  # of a standing collar's pieces; one without a fold is the strip itself

    def outline(self):
        return np.concatenate([s.points[:-1] for s in self.segments])


@dataclass
class Ring:
    """A collar's stand: a strip sewn to the neckline, upright; the leaf is folded over its upper edge.

    In pattern coordinates the strip lies between the neckline and `fold`, the neckline drawn together
    towards the middle of the neck, and the leaf from `fold` outwards, over the strip and beyond it.
    """

    line: np.ndarray  # neckline, clockwise, from one front end to the other
    middle: np.ndarray  # of the neck
    height: float
    lean: float  # outwards from upright, in front, radians
    lean_back: float  # likewise at the back: up to lying on the table
    opening: float  # of the fold between stand and leaf, radians
    drawn: float = 0.8

    def __post_init__(self):
        self.fold = self.inner(self.line)
        self.lengths = np.r_[0, np.cumsum(np.linalg.norm(np.diff(self.line, axis=0), axis=1))]
        self.outwards = g.offset(self.line, 1.0) - self.line

    def inner(self, p):
        return self.middle + self.drawn * (p - self.middle)

    def pattern(self, strip):
        """Pattern coordinates of points of the strip: (arc length along the neckline, height)."""
        p = g.at(self.line, strip[:, 0])
        return p + (self.inner(p) - p) * (strip[:, 1:] / self.height)

    def lean_at(self, s, begin):
        """begin: as the garment is laid out, before its shape pulls the back down."""
        y = g.at(self.line, s)[:, 1]
        t = np.clip(2.0 * (y - self.line[:, 1].min()) / np.ptp(self.line[:, 1]) - 0.9, 0, 1)
        lean = self.lean + (self.lean_back - self.lean) * t * t * (3 - 2 * t)
        return np.minimum(lean, 0.3) if begin else lean

    def at(self, s, height, begin=False):
        """Points of the stand at arc lengths s along the neckline; z up from the neckline."""
        foot, lean = g.at(self.line, s), self.lean_at(s, begin)
        out = np.c_[np.interp(s, self.lengths, self.outwards[:, 0]), np.interp(s, self.lengths, self.outwards[:, 1])]
        out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
        return np.c_[foot + out * (height * np.sin(lean))[:, None], height * np.cos(lean)]

    def leaf(self, p, floor, begin=False):
        """Points of the leaf, given in pattern coordinates: from the fold down to the floor, then flat;
        folded under a stand that leans far out."""
        s = g.project(p, self.fold)
        foot = g.at(self.fold, s)
        d = np.linalg.norm(p - foot, axis=1)
        away = (p - foot) / np.maximum(d, 1e-9)[:, None]
        s /= self.drawn
        top = self.at(s, np.full(len(p), self.height), begin)
        fall = (max(self.opening, 0.35) if begin else self.opening) - self.lean_at(s, begin)
        down = np.where(fall < 0, d, np.minimum(d, np.maximum(top[:, 2] - floor, 0) / np.cos(fall)))
        reach = down * np.sin(fall) + (d - down)
        return np.c_[top[:, :2] + away * reach[:, None], top[:, 2] - down * np.cos(fall)]


@dataclass
class Limb:
    """Sleeve, leg or hood that may turn in the plane, bend, or be folded over."""

    mask: np.ndarray  # polygon
    pivot: np.ndarray
    axis: np.ndarray  # unit vector outwards
    length: float
    inward: float  # how far it may turn towards the body, radians
    loose: float = 1.0  # how much farther than others it may turn outwards


@dataclass
class Garment:
    kind: str
    family: str
    held_out: bool
    cut: dict
    panels: list = field(default_factory=list)
    parts: list = field(default_factory=list)
    features: list = field(default_factory=list)
    limbs: list = field(default_factory=list)
    stiff_edges: list = field(default_factory=list)  # (edge, width, weight)
    stiff_panels: dict = field(default_factory=dict)  # name: weight

    def edge(self, name, panel):
        """The published polyline of a panel, None where it has none of this name."""
        for p in self.panels:
            if p.name == panel:
                found = [s.points for s in p.segments if s.edge == name]
                if not found:
                    return None
                line = np.concatenate(found)
                return line[np.r_[True, np.any(np.diff(line, axis=0) != 0, axis=1)]]
        raise KeyError(panel)

    def edges(self):
        names = sorted({s.edge for p in self.panels for s in p.segments if s.edge})
        return {n: {p.name: self.edge(n, p.name) for p in self.panels if self.edge(n, p.name) is not None} for n in names}

    def stiffness(self, panel, p):
        out = np.full(len(p), self.stiff_panels.get(panel.name, 0.0))
        for edge, width, weight in self.stiff_edges:
            line = self.edge(edge, panel.name)
            if line is not None:
                out = np.maximum(out, weight * (g.distance(p, line) <= width))
        return out

    def part(self, part, instance, *regions):
        """Regions: (panel, polygon) or (panel, edge name, width); edges a panel lacks are left out."""
        out = []
        for region in regions:
            if len(region) == 2:
                out.append({"panel": region[0], "polygon": region[1]})
            elif self.edge(region[1], region[0]) is not None:
                out.append({"panel": region[0], "edge": region[1], "width_m": region[2]})
        self.parts.append({"part": part, "instance": instance, "regions": out})

    def draw(self, kind, panel, **what):
        self.features.append({"kind": kind, "panel": panel, **what})

    def hem(self, edge, width, kind="hem", rows=2, spacing=0.006):
        """A hem or rib band along an edge of every panel that has it, and its stitching."""
        for p in self.panels:
            line = self.edge(edge, p.name)
            if line is None:
                continue
            self.draw(kind, p.name, edge=edge, width_m=width)
            inner = self.inwards(p, line, width)
            self.stitch(p.name, inner, rows, spacing)
        self.stiff_edges.append((edge, width, 0.5))

    def stitch(self, panel, polyline, rows=1, spacing=0.006):
        self.draw("twin-stitch" if rows == 2 else "stitch", panel, polyline=polyline, offset_m=spacing if rows == 2 else 0.0)

    @staticmethod
    def inwards(panel, line, d):
        """The line moved by d into the panel."""
        line = g.resample(line, max(0.01, g.length(line) / 40))
        for sign in (1, -1):
            moved = g.offset(line, sign * d)
            if g.inside(moved, panel.outline()).mean() > 0.5:
                return moved
        return line
