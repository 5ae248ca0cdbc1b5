"""Garment cuts: each function draws one cut of its type from continuous ranges (metres, degrees)."""
import math

import numpy as np

import geometry as g
from garment import Garment, Limb, Panel, Ring, Segment

GARMENTS = {}  # kind: (function, seen families, held-out families)


def garment(kind, seen, held_out):
    def register(function):
        GARMENTS[kind] = (function, seen, held_out)
        return function

    return register


def draw(kind, rng, held_out):
    _, seen, reserved = GARMENTS[kind]
    return cut(kind, str(rng.choice(reserved if held_out else seen)), rng, held_out)


def cut(kind, family, rng, held_out):
    """A cut of that family, drawn or not by draw()."""
    result = Garment(kind, family, held_out, {})
    GARMENTS[kind][0](result, rng, family)
    for limb in [limb for limb in result.limbs if limb.pivot[0] > 0]:
        result.limbs.append(Limb(limb.mask[::-1] * [-1, 1], limb.pivot * [-1, 1], limb.axis * [-1, 1], limb.length, limb.inward, limb.loose))
    result.cut = {k: v if isinstance(v, str) else round(float(v), 5) for k, v in result.cut.items()}
    return result


def _size(rng):
    """Adult sizes, a quarter of them smaller."""
    return rng.uniform(0.68, 0.9) if rng.random() < 0.25 else rng.uniform(0.93, 1.07)


def _neck_curve(half_width, y, dip, shape):
    """Right half of a neckline, from the shoulder's end at (half_width, y) to the middle."""
    if shape == "v":
        return g.bezier((half_width, y), (half_width * 0.85, y - dip * 0.3), (half_width * 0.3, y - dip * 0.75), (0.0, y - dip))
    t = np.linspace(0, math.pi / 2, 16)
    return np.c_[half_width * np.cos(t), y - dip * np.sin(t)]


def _opened(neck, gap):
    """Half a neckline that ends where a slit `gap` wide begins."""
    kept = neck[neck[:, 0] > gap / 2 + 0.002]
    return np.r_[kept, [[gap / 2, np.interp(gap / 2, neck[::-1, 0], neck[::-1, 1])]]]


class Torso:
    """Front and back of an upper garment with its sleeves in one piece."""

    def __init__(self, r, rng, size, sleeve, width=(0.235, 0.285), length=(0.62, 0.72), neck=(0.075, 0.092), dip=(0.075, 0.11), back_dip=(0.01, 0.025), neck_shape="round", hem_curve=0.0, rib_taper=0.0):
        u = lambda a, b: rng.uniform(a, b)
        self.w = w = size * u(*width)
        self.length = top = size * u(*length)
        self.nw = nw = (0.6 + 0.4 * size) * u(*neck)
        self.dip = dip = (0.6 + 0.4 * size) * u(*dip)
        self.back_dip = back_dip = u(*back_dip)
        drop, depth = size * u(0.03, 0.05), size * u(0.19, 0.23)
        self.shoulder = shoulder = g.points((w - size * u(0.0, 0.03), top - drop))[0]
        self.armpit = armpit = g.points((w, top - drop - depth))[0]
        if sleeve == "long":
            angle, reach = u(48, 73), size * u(0.54, 0.63)
            axis = np.array([math.cos(math.radians(angle)), -math.sin(math.radians(angle))])
            self.cuff_top = shoulder + reach * axis
            self.cuff_bottom = self.cuff_top + size * u(0.095, 0.125) * np.array([axis[1], -axis[0]])
        else:
            angle = u(18, 52) if sleeve == "short" else u(25, 55)
            axis = np.array([math.cos(math.radians(angle)), -math.sin(math.radians(angle))])
            under = size * (u(0.07, 0.13) if sleeve == "short" else u(0.015, 0.035))
            reach = under + size * (u(0.07, 0.11) if sleeve == "short" else u(0.05, 0.07))
            self.cuff_top = shoulder + reach * axis
            self.cuff_bottom = armpit + under * axis
        self.axis = axis
        r.cut.update(size=size, half_width=w, length=top, neck_half_width=nw, neck_dip=dip, sleeve_angle=angle, sleeve_length=reach, family=r.family)
        self.side = np.r_[
            g.points((w - rib_taper, hem_curve)) if not rib_taper else g.points((w - rib_taper, hem_curve), (w, 0.09)),
            armpit[None],
        ]
        self.under = np.stack([armpit, self.cuff_bottom])
        self.cuff = np.stack([self.cuff_bottom, self.cuff_top])
        self.over = np.stack([self.cuff_top, shoulder])
        self.ridge = np.stack([shoulder, [nw, top]])
        self.front_neck = _neck_curve(nw, top, dip, neck_shape)
        self.back_neck = _neck_curve(nw, top, back_dip, "round")
        x = np.linspace(-1, 1, 25)
        self.hem = np.c_[(w - rib_taper) * x, hem_curve * np.abs(x) ** 3]
        mask = g.grow(np.stack([shoulder, armpit, self.cuff_bottom, self.cuff_top]), 0.012)
        r.limbs.append(Limb(mask, (shoulder + armpit) / 2, axis, reach, math.radians(max(0, 74 - angle))))

    def segments(self, neck, slit=0.0, gap=0.0, front=True):
        """Outline from the hem counter-clockwise; `slit` opens the neck downwards, `gap` wide."""
        left = [
            Segment(self.side, "side_left", "side", True),
            Segment(self.under, "under_left", "side", True),
            Segment(self.cuff, "cuff_left"),
            Segment(self.over, "over_left", "side", True),
            Segment(self.ridge, "shoulder_left", "side", True),
        ]
        out = [Segment(self.hem, "hem"), *left]
        seam = "neck_front" if front else "neck_back"
        if slit:
            half = _opened(neck, gap)
            out += [
                Segment(half, "neck", seam),
                Segment(np.stack([half[-1], [0.0, half[-1, 1] - slit]]), "slit"),
                Segment(g.mirror(np.stack([half[-1], [0.0, half[-1, 1] - slit]])), "slit"),
                Segment(g.mirror(half), "neck", seam),
            ]
        else:
            out.append(Segment(np.r_[neck[:-1], g.mirror(neck)], "neck", seam))
        for s in reversed(left):
            name = s.edge.replace("left", "right")
            out.append(Segment(g.mirror(s.points), name, s.seam, s.silhouette))
        return out

    def panels(self, r, slit=0.0, gap=0.0):
        r.panels += [
            Panel("front", "front", 0, 0.5, self.segments(self.front_neck, slit, gap)),
            Panel("back", "back", 0, -0.5, self.segments(self.back_neck, front=False)),
        ]

    def armhole_stitches(self, r):
        line = g.bezier(self.shoulder, self.shoulder + [-0.03, -0.06], self.armpit + [-0.05, 0.06], self.armpit)
        for panel in ("front", "back"):
            for polyline in (line, g.mirror(line)):
                r.stitch(panel, polyline)

    def neck_label(self, r, rng):
        w, h = rng.uniform(0.02, 0.05), rng.uniform(0.012, 0.04)
        y = self.length - self.back_dip - 0.012 - h / 2
        r.draw("label", "back", polygon=g.rectangle(0.0, y, w, h), face="inside")

    def chest_pocket(self, r, rng):
        x, y, w = self.w * rng.uniform(0.4, 0.52), self.armpit[1] + rng.uniform(0.0, 0.06), rng.uniform(0.095, 0.12)
        h = w * rng.uniform(1.0, 1.2)
        p = g.points((x - w / 2, y + h / 2), (x - w / 2, y - h / 2 + 0.015), (x, y - h / 2), (x + w / 2, y - h / 2 + 0.015), (x + w / 2, y + h / 2))
        r.draw("pocket", "front", polygon=p, height_m=0.0015)
        r.stitch("front", np.r_[p] + (p.mean(0) - p) * 0.04)
        top = g.points((x - w / 2, y + h / 2 - 0.02), (x + w / 2, y + h / 2 - 0.02))
        r.stitch("front", top)

    def front_line(self):
        return self.length - self.dip

    def placket(self, r, width, bottom, slit, gap):
        """Both sides of the opening, which is `gap` wide at the neck and closes `slit` below it."""
        top = self.front_line()
        half = width / 2
        sides = g.points((half, bottom), (half, top - slit), (half + gap / 2, top))
        r.draw("placket", "front", polygon=np.r_[sides, g.mirror(sides)], height_m=0.0015)
        for sign in (1, -1):
            r.stitch("front", (sides - [0.003, 0]) * [sign, 1])

    def buttons(self, r, ys, slit, gap, radius):
        """On one side of the opening where it is open."""
        for y in ys:
            ajar = gap / 2 * max(0.0, 1 - (self.front_line() - y) / slit)
            r.draw("button", "front", center=[ajar + 1.6 * radius if ajar > 0 else 0.0, y], radius_m=radius)

    def collar(self, r, rng, width, point, spread, stand):
        """Leaf folded over at the neckline, or at the upper edge of a stand of that height (0: none):
        left and right front, and back; free at its outer edge."""
        half = _opened(self.front_neck, r.cut["slit_gap"])
        back = np.r_[self.back_neck[:-1], g.mirror(self.back_neck)]
        shoulder, ring, seams = half[0], None, ("neck_front", "neck_front", "neck_back")
        if stand:
            loop = np.r_[g.mirror(half), back[::-1][1:], half[1:]]
            middle = np.array([0.0, self.length - (self.dip + self.back_dip) / 2])
            lean_back = rng.uniform(-0.2, 0.5) if rng.random() < 0.45 else rng.uniform(0.8, 1.5)
            ring = Ring(loop, middle, stand, rng.uniform(-0.2, 0.5), lean_back, rng.uniform(0.25, 1.3))
            r.cut.update(collar_lean=lean_back)
            self._stand(r, ring, half, back)
            half, back = ring.inner(half), ring.inner(back)
            seams = ("collar_left", "collar_right", "collar_back")
        top = half[0]
        ridge_way = self.shoulder - shoulder
        side = shoulder + ridge_way * ((width - np.linalg.norm(top - shoulder)) / np.linalg.norm(ridge_way))
        tip = half[-1] + point * np.array([math.sin(spread), -math.cos(spread)])
        outer = g.bezier(tip, tip + [0.02, 0.25 * point], side + [0.012, -0.45 * width], side)
        for name, flip, seam in (("collar_left", False, seams[0]), ("collar_right", True, seams[1])):
            flipped = (lambda p: p * [-1, 1]) if flip else (lambda p: p)
            r.panels.append(
                Panel(
                    name,
                    "front",
                    1,
                    0.5,
                    [
                        Segment(flipped(half), "neck", seam),
                        Segment(flipped(np.stack([half[-1], tip])), "collar_front"),
                        Segment(flipped(outer), "collar_outer"),
                        Segment(flipped(np.stack([side, top])), None, "collar", True),
                    ],
                    fold=flipped(half),
                    ring=ring,
                )
            )
        x = np.linspace(1, -1, 25)
        fall = self.length - self.back_dip - width * rng.uniform(0.95, 1.15)
        if ring:  # beyond the neckline, over the table
            fall = back[len(back) // 2, 1] + width * rng.uniform(0.95, 1.1)
        edge = np.c_[side[0] * x, fall + (side[1] - fall) * np.abs(x) ** 3]
        r.panels.append(
            Panel(
                "collar_back",
                "front" if ring else "back",
                1,
                -0.5,
                [
                    Segment(back, "neck", seams[2]),
                    Segment(np.stack([back[-1], side * [-1, 1]]), None, "collar", True),
                    Segment(edge[::-1], "collar_outer"),
                    Segment(np.stack([side, top]), None, "collar", True),
                ],
                fold=back,
                ring=ring,
            )
        )
        for p in r.panels[-3:]:
            r.stiff_panels[p.name] = 1.0
            r.stitch(p.name, r.inwards(p, r.edge("collar_outer", p.name), 0.005))
        r.stiff_edges.append(("neck", 0.03, 1.0))
        r.cut.update(collar_width=width, collar_point=point, collar_stand=stand)

    def _stand(self, r, ring, half, back):
        """A strip: x along the neckline, y upwards. Its outside is the side that is seen, towards the neck."""
        pieces = ((g.mirror(half), "neck_front", "collar_right"), (back[::-1], "neck_back", "collar_back"), (half, "neck_front", "collar_left"))
        ends = np.cumsum([0.0] + [g.length(line) for line, _, _ in pieces])
        low, high = [], []
        for x0, x1, (line, neck, fold) in zip(ends[:-1], ends[1:], pieces):
            low.append(Segment(g.points((x0, 0.0), (x1, 0.0)), None, neck, along=line))
            high.insert(0, Segment(g.points((x1, ring.height), (x0, ring.height)), None, fold, along=ring.inner(line)[::-1]))
        sides = [Segment(g.points((ends[-1], 0.0), (ends[-1], ring.height))), Segment(g.points((0.0, ring.height), (0.0, 0.0)))]
        r.panels.append(Panel("collar_stand", "back", 1, 0.5, [*low, sides[0], *high, sides[1]], ring=ring))
        r.stiff_panels["collar_stand"] = 1.0

    def collar_part(self, r, part, first_button):
        """Around the collar, down to about the first button."""
        everything = g.rectangle(0, self.length, 2, 2)
        y = self.front_line()
        opening = g.points((-0.03, first_button - 0.012), (0.03, first_button - 0.012), (0.03, y + 0.02), (-0.03, y + 0.02))
        r.part(part, "collar", *[(p.name, everything) for p in r.panels if p.name.startswith("collar_")], ("front", "neck", 0.02), ("front", opening), ("back", "neck", 0.025))


def _cut_gap(rng):
    """Width at the neck of the slit of a placket: closed to open."""
    return rng.uniform(0.004, 0.012) if rng.random() < 0.6 else rng.uniform(0.012, 0.05)


@garment("tshirt", ("crew", "scoop"), ("v-neck", "cap-sleeve"))
def tshirt(r, rng, family):
    size = _size(rng)
    shape = {
        "crew": dict(dip=(0.06, 0.10)),
        "scoop": dict(neck=(0.09, 0.115), dip=(0.10, 0.15)),
        "v-neck": dict(neck_shape="v", dip=(0.13, 0.19)),
        "cap-sleeve": dict(width=(0.20, 0.24), neck=(0.09, 0.11), dip=(0.08, 0.12)),
        "long-sleeve": dict(dip=(0.06, 0.10)),
    }[family]
    t = Torso(r, rng, size, {"cap-sleeve": "cap", "long-sleeve": "long"}.get(family, "short"), **shape)
    t.panels(r)
    band = rng.uniform(0.012, 0.024)
    sleeve = rng.uniform(0.014, 0.026)
    hem = rng.uniform(0.018, 0.03)
    r.hem("neck", band, "rib", int(rng.integers(1, 3)))
    for edge in ("cuff_left", "cuff_right"):
        r.hem(edge, sleeve)
    r.hem("hem", hem)
    t.armhole_stitches(r)
    t.neck_label(r, rng)
    if rng.random() < 0.15:
        t.chest_pocket(r, rng)
    r.cut.update(neck_band=band, sleeve_hem=sleeve, hem=hem)
    r.part("t-shirt collar", "collar", ("front", "neck", 2 * band), ("back", "neck", 2 * band))
    for side in ("left", "right"):
        r.part("t-shirt sleeves", side, *[(p, f"cuff_{side}", 2 * sleeve) for p in ("front", "back")])


@garment("polo", ("regular", "slim"), ("cap-sleeve", "long-sleeve"))
def polo(r, rng, family):
    size = _size(rng)
    shape = {"regular": {}, "slim": dict(width=(0.20, 0.235)), "cap-sleeve": dict(width=(0.19, 0.225), length=(0.54, 0.62)), "long-sleeve": {}}[family]
    sleeve = {"cap-sleeve": "cap", "long-sleeve": "long"}.get(family, "short")
    t = Torso(r, rng, size, sleeve, dip=(0.05, 0.085), back_dip=(-0.03, 0.0), **shape)
    r.cut["slit_gap"] = gap = _cut_gap(rng)
    y = t.front_line()
    length = size * rng.uniform(0.10, 0.17)
    buttons = int(rng.integers(2, 4))
    ys = y - np.linspace(0.15, 0.85, buttons) * length
    closed = rng.random() < 0.4
    slit = y - ys[0] if closed else rng.uniform(0.5, 0.95) * length
    t.panels(r, slit, gap)
    stand = 0.0 if rng.random() < 0.2 else rng.uniform(0.018, 0.034)
    t.collar(r, rng, rng.uniform(0.05, 0.068) - 0.25 * stand, rng.uniform(0.06, 0.085), math.radians(rng.uniform(15, 50)), stand)
    width = rng.uniform(0.026, 0.036)
    t.placket(r, width, y - length, slit, gap)
    r.stitch("front", g.points((-width / 2, y - length + 0.002), (width / 2, y - length + 0.002)))
    t.buttons(r, ys, slit, gap, rng.uniform(0.0045, 0.0065))
    cuff = rng.uniform(0.018, 0.03)
    kind = "rib" if rng.random() < 0.7 else "hem"
    for edge in ("cuff_left", "cuff_right"):
        r.hem(edge, cuff, kind, 1 if kind == "rib" else 2)
    r.hem("hem", rng.uniform(0.018, 0.03))
    t.armhole_stitches(r)
    t.neck_label(r, rng)
    r.cut.update(placket=length, cuff=cuff, buttons=buttons)
    t.collar_part(r, "polo collar", ys[0])
    for side in ("left", "right"):
        r.part("polo sleeves", side, *[(p, f"cuff_{side}", 2 * cuff) for p in ("front", "back")])


@garment("shirt", ("straight", "curved-tail"), ("short-sleeve", "long-point"))
def shirt(r, rng, family):
    size = _size(rng)
    sleeve = "short" if family == "short-sleeve" else "long"
    curve = rng.uniform(0.04, 0.07) if family != "straight" else rng.uniform(0, 0.01)
    t = Torso(r, rng, size, sleeve, width=(0.23, 0.28), length=(0.68, 0.78), dip=(0.045, 0.075), back_dip=(-0.035, -0.005), hem_curve=curve)
    r.cut["slit_gap"] = gap = _cut_gap(rng)
    y = t.front_line()
    pitch = rng.uniform(0.075, 0.095)
    first = y - rng.uniform(0.012, 0.03)
    ys = np.arange(first, 0.08, -pitch)
    undone = int(rng.integers(0, 3))
    slit = max(0.03, y - ys[undone] - 0.01)
    t.panels(r, slit, gap)
    point = rng.uniform(0.095, 0.13) if family == "long-point" else rng.uniform(0.07, 0.09)
    stand = 0.0 if rng.random() < 0.1 else rng.uniform(0.024, 0.036)
    t.collar(r, rng, rng.uniform(0.05, 0.06) - 0.2 * stand, point, math.radians(rng.uniform(12, 50)), stand)
    width = rng.uniform(0.028, 0.038)
    t.placket(r, width, 0.0, slit, gap)
    radius = rng.uniform(0.005, 0.0065)
    t.buttons(r, ys, slit, gap, radius)
    cuff = rng.uniform(0.055, 0.075) if sleeve == "long" else rng.uniform(0.022, 0.035)
    for side in ("left", "right"):
        r.hem(f"cuff_{side}", cuff, "hem", 1)
        r.stiff_edges.append((f"cuff_{side}", cuff, 1.0))
        if sleeve == "long":
            line = t.cuff if side == "left" else t.cuff * [-1, 1]
            inward = -t.axis if side == "left" else -t.axis * [-1, 1]
            for s in (0.2, 0.32)[: int(rng.integers(1, 3))]:
                r.draw("button", "back", center=(line[0] + s * (line[1] - line[0]) + inward * cuff / 2).tolist(), radius_m=radius)
    r.hem("hem", rng.uniform(0.006, 0.015), rows=1)
    t.armhole_stitches(r)
    yoke = t.length - rng.uniform(0.09, 0.12)
    x = t.shoulder[0] - 0.01
    r.draw("yoke", "back", polygon=g.points((-x, yoke), (x, yoke), (x, t.length - 0.03), (t.nw, t.length), (-t.nw, t.length), (-x, t.length - 0.03)))
    r.stitch("back", g.points((-x, yoke), (x, yoke)))
    t.neck_label(r, rng)
    if rng.random() < 0.7:
        t.chest_pocket(r, rng)
    r.cut.update(cuff=cuff, buttons=len(ys))
    t.collar_part(r, "shirt collar", ys[0])
    for side in ("left", "right"):
        r.part("shirt sleeves", side, *[(p, f"cuff_{side}", cuff + 0.006) for p in ("front", "back")])


@garment("sweater", ("pullover", "oversized"), ("zip", "cropped"))
def sweater(r, rng, family):
    size = _size(rng)
    shape = {
        "pullover": {},
        "oversized": dict(width=(0.28, 0.33)),
        "zip": {},
        "cropped": dict(width=(0.25, 0.30), length=(0.44, 0.52)),
    }[family]
    t = Torso(r, rng, size, "long", **({"length": (0.60, 0.70), "neck": (0.09, 0.105), "dip": (0.07, 0.11), "back_dip": (0.005, 0.02), "rib_taper": 0.02} | shape))
    t.panels(r)
    nw, top, y = t.nw, t.length, t.front_line()
    height, half = size * rng.uniform(0.30, 0.36), size * rng.uniform(0.125, 0.155)
    outer = np.r_[
        g.bezier((nw, top), (nw + 0.01, top + 0.03), (half, top + 0.05), (half, top + 0.5 * height), 12)[:-1],
        g.bezier((half, top + 0.5 * height), (half, top + 0.85 * height), (0.6 * half, top + height), (0, top + height), 14),
    ]
    silhouette = np.r_[outer[:-1], g.mirror(outer)]
    mouth = half * rng.uniform(0.5, 0.68)
    low = rng.uniform(0.004, 0.02)
    join = int(np.searchsorted(-t.front_neck[:, 0], -low))
    neck = np.r_[t.front_neck[:join], g.points((low, np.interp(-low, -t.front_neck[:, 0], t.front_neck[:, 1])))]
    high = top + height * rng.uniform(0.72, 0.86)
    opening = np.r_[
        g.bezier(neck[-1], neck[-1] + [0.03, 0.05], (mouth, y + 0.08), (mouth, (y + high) / 2 + 0.02), 12)[:-1],
        g.bezier((mouth, (y + high) / 2 + 0.02), (mouth, high - 0.03), (mouth * 0.6, high), (0, high), 12),
    ]
    # The neckline of the body's front must have the very points at which the hood is sewn on.
    front = r.panels[0]
    k = next(i for i, s in enumerate(front.segments) if s.edge == "neck")
    front.segments[k : k + 1] = [
        Segment(neck, "neck", "neck_front"),
        Segment(np.stack([neck[-1], neck[-1] * [-1, 1]]), "neck"),
        Segment(g.mirror(neck), "neck", "neck_front"),
    ]
    r.panels += [
        Panel(
            "hood_front",
            "front",
            0,
            0.5,
            [
                Segment(silhouette, "hood_outline", "hood", True),
                Segment(neck * [-1, 1], "neck", "neck_front"),
                Segment(np.r_[opening[:-1], g.mirror(opening)] * [-1, 1], "hood_edge"),
                Segment(neck[::-1], "neck", "neck_front"),
            ],
        ),
        Panel(
            "hood_back",
            "back",
            0,
            -0.5,
            [
                Segment(silhouette, "hood_outline", "hood", True),
                Segment(np.r_[t.back_neck[:-1], g.mirror(t.back_neck)][::-1], "neck", "neck_back"),
            ],
        ),
    ]
    above = g.points((-half - 0.05, top), (half + 0.05, top), (half + 0.05, top + height + 0.05), (-half - 0.05, top + height + 0.05))
    r.limbs.append(Limb(above, np.array([0.0, top + 0.06]), np.array([0.0, 1.0]), height, 0.4))
    r.hem("hood_edge", rng.uniform(0.02, 0.03), "hem", 1)
    cuff, band = rng.uniform(0.05, 0.08), rng.uniform(0.05, 0.07)
    for side in ("left", "right"):
        r.hem(f"cuff_{side}", cuff, "rib", 1)
    r.hem("hem", band, "rib", 1)
    t.armhole_stitches(r)
    r.stitch("front", r.inwards(front, r.edge("neck", "front"), 0.006))
    r.stitch("back", r.inwards(r.panels[1], r.edge("neck", "back"), 0.006))
    r.draw("label", "back", polygon=g.rectangle(0, top - t.back_dip - 0.03, 0.045, 0.03), face="inside")
    r.stitch("hood_back", g.points((0, top - t.back_dip), (0, top + height)))
    if family == "zip":
        r.draw("placket", "front", polygon=g.points((-0.012, 0), (0.012, 0), (0.012, y), (-0.012, y)), zip=True, height_m=0.002)
    else:
        w, h = t.w * rng.uniform(0.62, 0.75), size * rng.uniform(0.15, 0.2)
        b = band + 0.005
        pocket = g.points((-w, b), (w, b), (w, b + 0.4 * h), (0.62 * w, b + h), (-0.62 * w, b + h), (-w, b + 0.4 * h))
        r.draw("pocket", "front", polygon=pocket, height_m=0.003)
        r.stitch("front", np.r_[pocket, pocket[:1]])
    if rng.random() < 0.75:
        drop, width = rng.uniform(0.1, 0.2), rng.uniform(0.004, 0.008)
        for s in (-1, 1):
            line = g.bezier((s * 0.03, y - 0.004), (s * 0.04, y - 0.3 * drop), (s * rng.uniform(0.02, 0.06), y - 0.7 * drop), (s * rng.uniform(0.02, 0.07), y - drop))
            r.draw("cord", "front", polyline=line, width_m=width)
    r.cut.update(hood_height=height, hood_half_width=half, hood_opening=mouth, cuff=cuff)
    everything = g.rectangle(0, top, 3, 3)
    r.part("sweater hood", "hood", ("hood_front", everything), ("hood_back", everything), ("front", "neck", 0.008), ("back", "neck", 0.008))
    for side in ("left", "right"):
        r.part("sweater sleeves", side, *[(p, f"cuff_{side}", cuff + 0.006) for p in ("front", "back")])


@garment("jeans", ("straight", "slim"), ("flared", "shorts"))
def jeans(r, rng, family):
    size = _size(rng)
    u = lambda a, b: size * rng.uniform(a, b)
    long = family != "shorts"
    waist, top = u(0.17, 0.215), u(0.96, 1.06) if long else u(0.42, 0.56)
    hip, rise = waist + u(0.015, 0.045), u(0.23, 0.28)
    leg = {"straight": (0.085, 0.105), "slim": (0.065, 0.085), "flared": (0.12, 0.155), "shorts": (0.12, 0.145)}[family]
    leg = u(*leg)
    middle = max(leg + 0.015 * size, u(0.105, 0.17))
    crotch = top - rise
    knee = crotch * 0.45
    thin = min(leg, u(0.08, 0.095)) if family == "flared" else None
    out = g.points((middle + leg, 0), (hip, crotch + 0.06), (waist, top))
    inner = g.points((0, crotch), (middle - leg, 0))
    if thin:
        out = g.points((middle + leg, 0), ((middle + hip) / 2 * 0.85 + thin * 0.5, knee), (hip, crotch + 0.06), (waist, top))
        inner = g.points((0, crotch), ((middle + hip) / 2 * 0.85 - thin * 1.3, knee), (middle - leg, 0))
    dip, back_dip = u(0.025, 0.075), u(-0.03, 0.0)
    band = rng.uniform(0.034, 0.044)
    open_fly = rng.random() < 0.25
    slit = rng.uniform(0.06, 0.12) if open_fly else band + rng.uniform(0.0, 0.01)
    gap = rng.uniform(0.03, 0.08) if open_fly else rng.uniform(0.003, 0.006)
    line = _neck_curve(waist, top, dip, "round")
    line[:, 1] = top - dip * (1 - (line[:, 0] / waist) ** 2)
    opened = line.copy()
    opened[-1, 0] = gap / 2
    down = np.stack([opened[-1], [0, opened[-1, 1] - slit]])
    back_line = np.c_[line[:, 0], top - back_dip * (1 - (line[:, 0] / waist) ** 2)]

    def outline(front):
        if front:
            upper = [Segment(opened, "waist"), Segment(down, "slit"), Segment(g.mirror(down), "slit"), Segment(g.mirror(opened), "waist")]
        else:
            upper = [Segment(np.r_[back_line[:-1], g.mirror(back_line)], "waist")]
        return [
            Segment(g.points((middle - leg, 0), (middle + leg, 0)), "leg_left"),
            Segment(out, "side_left", "side", True),
            *upper,
            Segment(g.mirror(out), "side_right", "side", True),
            Segment(g.points((-middle - leg, 0), (-middle + leg, 0)), "leg_right"),
            Segment(g.mirror(inner), "inseam_right", "side", True),
            Segment(inner, "inseam_left", "side", True),
        ]

    r.panels += [Panel("front", "front", 0, 0.5, outline(True)), Panel("back", "back", 0, -0.5, outline(False))]
    mask = g.points((0.0005, -0.05), (0.6, -0.05), (0.6, crotch), (0.0005, crotch))
    axis = np.array([middle - 0.4 * hip, -crotch])
    r.limbs.append(Limb(mask, np.array([0.45 * hip, crotch]), axis / np.linalg.norm(axis), crotch, 0.0, 1.8 if long else 1.0))

    half_x = lambda y: float(np.interp(y, out[:, 1], out[:, 0]))
    lower = line - [0, band]  # lower border of the waistband, middle to the left: x from waist to 0
    lower[0, 0] = half_x(lower[0, 1])
    back_lower = back_line - [0, band]
    back_lower[0, 0] = half_x(back_lower[0, 1])
    for panel, upper, low in (("front", line, lower), ("back", back_line, back_lower)):
        whole = np.r_[upper[:-1], g.mirror(upper)]
        below = np.r_[low[:-1], g.mirror(low)]
        r.draw("waistband", panel, polygon=np.r_[whole, below[::-1]], height_m=0.002)
        r.stitch(panel, below, 2)
        r.stitch(panel, whole - [0, 0.004])
        at = lambda x: float(np.interp(x, whole[::-1, 0], whole[::-1, 1]))
        for x in (-0.55 * waist, 0.55 * waist) if panel == "front" else (-0.62 * waist, 0.0, 0.62 * waist):
            r.draw("belt-loop", panel, polygon=g.rectangle(x, at(x) - band / 2, rng.uniform(0.010, 0.013), band + 0.012), height_m=0.003)
    r.draw("button", "front", center=[gap / 2 + 0.01 if open_fly else 0.0, line[-1, 1] - band / 2], radius_m=rng.uniform(0.007, 0.0095))
    centre = lower[-1, 1]
    # Front pockets: the opening's curve from the waistband to the side seam.
    x0 = waist * rng.uniform(0.5, 0.68)
    start = np.array([x0, float(np.interp(x0, lower[::-1, 0], lower[::-1, 1]))])
    y1 = top - band - size * rng.uniform(0.065, 0.10)
    end = np.array([half_x(y1), y1])
    curve = g.bezier(start, (start[0] + 0.004, y1 + 0.01), (0.6 * start[0] + 0.4 * end[0], y1), end, 12)
    corner = g.points((half_x(lower[0, 1]), lower[0, 1]))
    for sign in (1, -1):
        r.draw("pocket", "front", polygon=np.r_[curve, corner] * [sign, 1], height_m=-0.001, opening=True)
        r.stitch("front", (curve + [-0.006, -0.006]) * [sign, 1], 2)
        for p in (start + [-0.004, -0.006], end + [-0.012, -0.004]):
            r.draw("rivet", "front", center=(p * [sign, 1]).tolist(), radius_m=0.0045)
    coin = g.points(end + [-0.075, 0.012], end + [-0.02, 0.012], end + [-0.02, 0.05], end + [-0.062, 0.05])
    r.stitch("front", coin[[0, 3, 2]] * [-1, 1])
    fly, length = rng.uniform(0.034, 0.042), size * rng.uniform(0.12, 0.16)
    bottom = centre - length
    j = np.r_[g.points((fly, centre), (fly, bottom + 0.05)), g.bezier((fly, bottom + 0.05), (fly, bottom + 0.015), (0.02, bottom), (0.0, bottom), 10)]
    r.draw("fly", "front", polygon=np.r_[j, g.points((0, centre))], height_m=0.0015)
    r.stitch("front", j, 2)
    r.stitch("front", g.points((0, centre), (0, crotch)), 2)
    # Behind: yoke, seat seam, patch pockets, leather patch; label inside.
    yoke = size * rng.uniform(0.05, 0.075)
    vee = g.points((half_x(top - band - yoke * 0.55), top - band - yoke * 0.55), (0, top - back_dip - band - yoke))
    vee = np.r_[vee[:-1], g.mirror(vee)] if len(vee) > 2 else np.r_[vee, [vee[0] * [-1, 1]]]
    r.draw("yoke", "back", polygon=np.r_[vee, np.r_[back_lower[:-1], g.mirror(back_lower)][::-1]])
    r.stitch("back", vee, 2)
    r.stitch("back", g.points((0, vee[1, 1]), (0, crotch)), 2)
    w, h = size * rng.uniform(0.062, 0.075), size * rng.uniform(0.13, 0.155)
    cx, cy = hip * rng.uniform(0.48, 0.54), vee[1, 1] - rng.uniform(0.005, 0.03)
    for sign in (1, -1):
        pocket = g.points((cx - w, cy), (cx - 0.88 * w, cy - 0.8 * h), (cx, cy - h), (cx + 0.88 * w, cy - 0.8 * h), (cx + w, cy + 0.008)) * [sign, 1]
        r.draw("pocket", "back", polygon=pocket, height_m=0.0015)
        r.stitch("back", np.r_[pocket, pocket[:1]] * 0.97 + pocket.mean(0) * 0.03, 2)
    if rng.random() < 0.7:
        r.draw("label", "back", polygon=g.rectangle(-0.45 * waist, top - back_dip * 0.5 - band / 2, 0.055, band * 0.9), face="outside")
    for _ in range(int(rng.integers(1, 3))):
        r.draw("label", "back", polygon=g.rectangle(rng.uniform(-0.4, 0.4) * waist, top - back_dip - rng.uniform(0.02, 0.05), rng.uniform(0.03, 0.06), rng.uniform(0.02, 0.04)), face="inside")
    hem = rng.uniform(0.012, 0.024)
    for edge in ("leg_left", "leg_right"):
        r.hem(edge, hem, rows=int(rng.integers(1, 3)))
    r.stiff_edges.append(("waist", band, 1.0))
    r.cut.update(size=size, waist_half_width=waist, length=top, rise=rise, leg_half_width=leg, waistband=band, waist_dip=dip, open_fly=float(open_fly), hem=hem, family=family)
    depth = min(bottom, y1) - 0.012
    hips = g.points((-1, 2), (-1, y1 - 0.015), (-end[0], y1 - 0.015), (-0.055, depth), (0.055, depth), (end[0], y1 - 0.015), (1, y1 - 0.015), (1, 2))
    r.part("jeans hips", "hips", ("front", hips), ("back", "waist", band + 0.018))
    for side in ("left", "right"):
        r.part("jeans pants hemline", side, *[(p, f"leg_{side}", max(0.02, 1.67 * hem)) for p in ("front", "back")])


@garment("dress", ("scoop", "short-sleeve"), ("strap", "shift"))
def dress(r, rng, family):
    size = _size(rng)
    u = lambda a, b: size * rng.uniform(a, b)
    bust, waist, top = u(0.20, 0.245), u(0.165, 0.205), u(0.80, 0.98)
    skirt = u(0.21, 0.26) if family == "shift" else u(0.26, 0.40)
    if family == "shift":
        waist = bust - u(0.0, 0.02)
    nw = u(0.075, 0.11)
    strap = u(0.025, 0.04) if family == "strap" else u(0.045, 0.07)
    if family == "strap":
        nw = u(0.06, 0.085)
    drop = u(0.005, 0.025)
    pit, waist_y = top - u(0.19, 0.23), top - u(0.37, 0.43)
    dip = {"scoop": (0.10, 0.16), "short-sleeve": (0.08, 0.13), "strap": (0.14, 0.19), "shift": (0.05, 0.08)}[family]
    dip, back_dip = u(*dip), u(0.03, 0.10) if family != "short-sleeve" else u(0.015, 0.05)
    shape = "v" if family == "strap" and rng.random() < 0.5 else "round"
    shoulder, armpit = np.array([nw + strap, top - drop]), np.array([bust, pit])
    curve = u(0.02, 0.05)
    side = np.r_[g.bezier((skirt, curve), (0.7 * skirt + 0.3 * waist, 0.4 * waist_y), (waist + 0.02, 0.8 * waist_y), (waist, waist_y), 14)[:-1], g.bezier((waist, waist_y), (waist, waist_y + 0.06), (bust, pit - 0.06), armpit, 8)]
    x = np.linspace(-1, 1, 31)
    hem = np.c_[skirt * x, curve * x**2]
    if family == "short-sleeve":
        angle, under = math.radians(rng.uniform(20, 50)), u(0.03, 0.08)
        axis = np.array([math.cos(angle), -math.sin(angle)])
        cuff_bottom, cuff_top = armpit + under * axis, shoulder + (under + u(0.07, 0.1)) * axis
        arm = [
            Segment(np.stack([armpit, cuff_bottom]), None, "side", True),
            Segment(np.stack([cuff_bottom, cuff_top]), "armhole_left"),
            Segment(np.stack([cuff_top, shoulder]), None, "side", True),
        ]
    else:
        arm = [Segment(g.bezier(armpit, (bust - 0.06, pit + 0.02), (shoulder[0] - 0.015, shoulder[1] - 0.07), shoulder, 16), "armhole_left")]
    left = [Segment(side, "side_left", "side", True), *arm, Segment(np.stack([shoulder, [nw, top]]), "shoulder_left", "side", True)]
    for name, d, level in (("front", dip, 0.5), ("back", back_dip, -0.5)):
        half = _neck_curve(nw, top, d, shape if name == "front" else "round")
        right = [Segment(g.mirror(s.points), s.edge and s.edge.replace("left", "right"), s.seam, s.silhouette) for s in reversed(left)]
        r.panels.append(Panel(name, name, 0, level, [Segment(hem, "hem"), *left, Segment(np.r_[half[:-1], g.mirror(half)], "neck"), *right]))
    trim = rng.uniform(0.006, 0.014)
    for edge in ("neck", "armhole_left", "armhole_right"):
        r.hem(edge, trim, rows=1)
    r.hem("hem", rng.uniform(0.012, 0.03), rows=1)
    for panel in ("front", "back"):
        if family != "shift":
            r.draw("stitch", panel, polyline=g.points((-waist, waist_y), (waist, waist_y)), offset_m=0.0, seam=True)
        if rng.random() < 0.6:
            for s in (1, -1):
                r.stitch(panel, g.bezier((s * 0.45 * waist, waist_y), (s * 0.45 * waist, waist_y + 0.05), (s * 0.5 * bust, pit - 0.06), (s * 0.5 * bust, pit - 0.03), 8))
    r.draw("label", "back", polygon=g.rectangle(0, top - back_dip - 0.025, 0.03, 0.02), face="inside")
    if family == "scoop" and rng.random() < 0.3:
        r.draw("placket", "back", polygon=g.points((-0.008, waist_y - 0.1), (0.008, waist_y - 0.1), (0.008, top - back_dip), (-0.008, top - back_dip)), zip=True, height_m=0.001)
    r.cut.update(size=size, bust=bust, waist=waist, skirt=skirt, length=top, strap=strap, neck_dip=dip, family=family)
    low = pit - 0.02
    region = g.points((-1, low), (1, low), (1, 2), (-1, 2))
    r.part("dress collar", "collar", ("front", region), ("back", region))


def _sheet(r, rng, width, length, bands):
    w, h = width / 2, length / 2
    border = [g.points((-w, -h), (w, -h)), g.points((w, -h), (w, h)), g.points((w, h), (-w, h)), g.points((-w, h), (-w, -h))]
    names = ("hem_bottom", "hem_right", "hem_top", "hem_left")
    r.panels.append(Panel("front", "front", 0, 0.0, [Segment(s, n) for s, n in zip(border, names)]))
    hem = rng.uniform(0.006, 0.02)
    for n in names:
        r.hem(n, hem, rows=1)
    for y in bands:
        for sign in (-1, 1):
            for d in (0.0, rng.uniform(0.02, 0.05)):
                r.stitch("front", g.points((-w, sign * (h - y - d)), (w, sign * (h - y - d))))
    if rng.random() < 0.4:
        r.draw("label", "front", polygon=g.rectangle(w - 0.04, -h + 0.03, 0.03, 0.02), face="inside")
    r.cut.update(width=width, length=length, hem=hem, family=r.family)


@garment("towel", ("hand", "tea"), ("square", "bath"))
def towel(r, rng, family):
    width, length = {"hand": ((0.4, 0.55), (0.7, 1.0)), "tea": ((0.42, 0.52), (0.6, 0.75)), "square": ((0.28, 0.4), (0.28, 0.4)), "bath": ((0.6, 0.75), (1.1, 1.3))}[family]
    _sheet(r, rng, rng.uniform(*width), rng.uniform(*length), [rng.uniform(0.04, 0.1)] if family != "tea" else [])


@garment("blanket", ("throw", "baby"), ("long", "square"))
def blanket(r, rng, family):
    width, length = {"throw": ((0.9, 1.2), (1.1, 1.4)), "baby": ((0.65, 0.8), (0.75, 1.0)), "long": ((0.6, 0.8), (1.3, 1.6)), "square": ((0.9, 1.1), (0.9, 1.1))}[family]
    _sheet(r, rng, rng.uniform(*width), rng.uniform(*length), [])
