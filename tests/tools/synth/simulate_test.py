"""Tests of the cloth simulator, run by Blender (see CMakeLists.txt)."""
import json
import os
import sys
import tempfile
import unittest

import numpy as np

SIMULATE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../../tools/synth/simulate")
sys.path.insert(0, SIMULATE)

import check_states
import checks
import geometry as g
import main
import mesh as meshes
import patterns
import states
import tshirt_states
import tshirts
import wsim
from garment import Ring


def every_cut():
    for kind, (_, seen, held_out) in patterns.GARMENTS.items():
        for family in seen + held_out:
            for seed in range(2):
                yield kind, family, seed


def cut(kind, family, seed):
    function, seen, held_out = patterns.GARMENTS[kind]
    rng = np.random.default_rng(seed)
    # Draw until the family comes up: the families of a kind are equally likely.
    for _ in range(100):
        garment = patterns.draw(kind, rng, family in held_out)
        if garment.family == family:
            return garment
    raise AssertionError(f"{kind}: {family} is never drawn")


def read(path):
    with open(path, "rb") as f:
        return f.read()


def border_loops(faces):
    """Number of closed loops of edges that belong to one face only."""
    e = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, count = np.unique(e, axis=0, return_counts=True)
    neighbours = {}
    for a, b in unique[count == 1].tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    loops, seen = 0, set()
    for start in neighbours:
        if start in seen:
            continue
        loops += 1
        stack = [start]
        while stack:
            v = stack.pop()
            if v not in seen:
                seen.add(v)
                stack += neighbours[v]
    return loops


def build(garment, step=0.03):
    return meshes.build(garment, step, 0.007, np.random.default_rng(7))


class Geometry(unittest.TestCase):
    def test_inside_and_distance_agree_with_a_disc(self):
        t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
        disc = np.c_[np.cos(t), np.sin(t)]
        p = np.random.default_rng(1).uniform(-1.5, 1.5, (500, 2))
        radius = np.linalg.norm(p, axis=1)
        clear = np.abs(radius - 1) > 1e-3
        np.testing.assert_array_equal(g.inside(p, disc)[clear], (radius < 1)[clear])
        np.testing.assert_allclose(g.distance(p, np.r_[disc, disc[:1]]), np.abs(radius - 1), atol=1e-4)

    def test_resampling_keeps_corners_and_length(self):
        line = g.points((0, 0), (1, 0), (1, 0.5))
        r = g.resample(line, 0.1)
        self.assertAlmostEqual(g.length(r), 1.5, places=12)
        self.assertTrue((r == [1, 0]).all(1).any())


class Patterns(unittest.TestCase):
    def test_every_cut_is_sewn_and_has_its_parts(self):
        for kind, family, seed in every_cut():
            with self.subTest(kind=kind, family=family, seed=seed):
                garment = cut(kind, family, seed)
                mesh = build(garment)
                names = [p.name for p in garment.panels]
                centre = mesh.pattern[mesh.faces].mean(1)
                for part in garment.parts:
                    found = 0
                    for region in part["regions"]:
                        p = centre[mesh.panel == names.index(region["panel"])]
                        if "polygon" in region:
                            found += g.inside(p, region["polygon"]).sum()
                        else:
                            # Bands are narrower than these triangles: ask for their edges' points.
                            line = garment.edge(region["edge"], region["panel"])
                            found += (g.distance(p, line) < region["width_m"] + 0.03).sum()
                    self.assertGreater(found, 0, part["part"] + " " + part["instance"])
                for feature in garment.features:
                    self.assertIn(feature["panel"], names)
                up = np.cross(*(np.diff(mesh.pattern[mesh.faces], axis=1).transpose(1, 0, 2)))
                front = np.array([p.side == "front" for p in garment.panels])[mesh.panel]
                self.assertTrue(((up > 0) == front).all(), "a face is seen from the wrong side")

    def test_openings_are_those_of_the_garment(self):
        # Hem, neck and two sleeves; waist and two legs; one border. Unsewn seams would add loops.
        for kind, family, loops in (("tshirt", "crew", 4), ("tshirt", "v-neck", 4), ("jeans", "slim", 3), ("dress", "scoop", 4), ("towel", "hand", 1)):
            with self.subTest(kind=kind, family=family):
                self.assertEqual(border_loops(build(cut(kind, family, 1)).faces), loops)

    def test_collar_and_hood_hang_together_with_the_body(self):
        for kind, family in (("polo", "regular"), ("shirt", "straight"), ("sweater", "pullover")):
            mesh = build(cut(kind, family, 2))
            group = np.arange(len(mesh.rest))
            for _ in range(len(group)):
                low = group[mesh.faces].min(1)
                before = group.copy()
                for k in range(3):
                    np.minimum.at(group, mesh.faces[:, k], low)
                if (group == before).all():
                    break
            self.assertEqual(len(np.unique(group)), 1, kind)


class StandingCollars(unittest.TestCase):
    def test_a_ring_on_a_circle_is_a_cone(self):
        t = np.linspace(np.pi, -np.pi, 721)  # clockwise
        ring = Ring(0.08 * np.c_[np.cos(t), np.sin(t)], np.zeros(2), 0.03, 0.2, 0.2, 0.9)
        s, height = np.linspace(0.02, 0.48, 9), np.linspace(0, 0.03, 9)
        p = ring.at(s, height)
        np.testing.assert_allclose(np.hypot(p[:, 0], p[:, 1]), 0.08 + height * np.sin(0.2), atol=1e-5)
        np.testing.assert_allclose(p[:, 2], height * np.cos(0.2), atol=1e-12)
        np.testing.assert_allclose(np.arctan2(p[:, 1], p[:, 0]), np.pi - s / 0.08, atol=1e-3)
        # The leaf goes down from the stand's edge to the floor and then lies flat; its lengths stay.
        d = np.linspace(0, 0.09, 200)
        leaf = ring.leaf(np.c_[-0.8 * 0.08 - d, 0 * d], 0.007)
        self.assertAlmostEqual(leaf[0, 2], 0.03 * np.cos(0.2), places=6)
        self.assertAlmostEqual(leaf[-1, 2], 0.007, places=6)
        self.assertLess(np.diff(leaf[:, 2]).max(), 1e-9)
        way = np.linalg.norm(np.diff(leaf, axis=0), axis=1)
        self.assertAlmostEqual(way.sum(), 0.09, places=3)

    def test_the_back_may_lie_down_on_its_leaf_but_begins_upright(self):
        t = np.linspace(-np.pi / 2 - 0.1, -2.5 * np.pi + 0.1, 721)  # clockwise from the front end
        ring = Ring(0.08 * np.c_[np.cos(t), np.sin(t)], np.zeros(2), 0.03, 0.0, 1.5, 0.4)
        half = np.array([ring.lengths[-1] / 2])
        lying, upright = ring.at(half, np.array([0.03])), ring.at(half, np.array([0.03]), True)
        self.assertLess(lying[0, 2], 0.003)
        self.assertGreater(lying[0, 1], 0.109)
        self.assertGreater(upright[0, 2], 0.028)
        front = ring.at(np.array([0.0]), np.array([0.03]))
        self.assertAlmostEqual(front[0, 2], 0.03, places=9)
        d = np.linspace(0, 0.04, 50)
        back = np.c_[0 * d, 0.8 * 0.08 + d]
        under, beside = ring.leaf(back, 0.007), ring.leaf(back, 0.007, True)
        self.assertTrue((np.diff(under[:, 1]) < 0).all() and (under[1:, 2] < lying[0, 2]).all())
        self.assertTrue((np.diff(beside[:, 1]) > 0).all() and (beside[:, 2] > 0.00699).all())

    def test_stands_are_sewn_to_neck_and_leaf_and_upright(self):
        for kind in ("polo", "shirt"):
            _, seen, reserved = patterns.GARMENTS[kind]
            stands = 0
            for family in seen + reserved:
                for seed in range(12):
                    garment = patterns.cut(kind, family, np.random.default_rng(seed), family in reserved)
                    mesh = build(garment, 0.013)
                    # Hem, sleeves, and one along slit, stand and leaf: a seam left open would add loops.
                    self.assertEqual(border_loops(mesh.faces), 4, f"{kind} {family} {seed}")
                    stand = garment.cut["collar_stand"]
                    names = [p.name for p in garment.panels]
                    self.assertEqual(stand > 0, "collar_stand" in names)
                    if not stand:
                        continue
                    stands += 1
                    ring = garment.panels[names.index("collar_stand")].ring
                    own = np.unique(mesh.faces[mesh.panel == names.index("collar_stand")])
                    fold = own[g.distance(mesh.pattern[own], ring.fold) < 1e-6]
                    s = g.project(mesh.pattern[fold], ring.fold) / ring.drawn
                    for p, begin in ((mesh.rest, False), (mesh.start, True)):
                        upright = ring.height * np.cos(ring.lean_at(s, begin))
                        np.testing.assert_allclose(p[fold, 2], 0.0035 + upright, atol=1e-6)
                    self.assertGreater(mesh.start[fold, 2].min(), 0.0035 + 0.9 * stand)
            self.assertGreater(stands, 15)


class States(unittest.TestCase):
    def test_a_fold_does_not_stretch_the_cloth(self):
        rng = np.random.default_rng(3)
        n = 60
        x, y = np.meshgrid(np.linspace(-0.3, 0.3, n), np.linspace(-0.3, 0.3, n))
        p = np.c_[x.ravel(), y.ravel(), np.full(n * n, 0.01)]
        q = states._fold(p, np.ones(len(p), bool), np.array([0.05, 0.0]), states._direction(rng.uniform(0, 6)), 0.012)
        grid = np.arange(n * n).reshape(n, n)
        for a, b in ((grid[:, :-1], grid[:, 1:]), (grid[:-1], grid[1:])):
            before = np.linalg.norm(p[a.ravel()] - p[b.ravel()], axis=1)
            after = np.linalg.norm(q[a.ravel()] - q[b.ravel()], axis=1)
            # A chord is shorter than its arc: at most 10 % at this grid and radius.
            self.assertTrue((after < before * 1.0001).all() and (after > before * 0.9).all())
        self.assertGreater(q[:, 2].max(), 0.03)


class TshirtStates(unittest.TestCase):
    def folded(self, state, way, seed):
        """(box of the body laid flat, box after the folds), without cloth simulation between them."""
        rng = np.random.default_rng(seed)
        garment = patterns.cut("tshirt", "crew", rng, False)
        mesh = build(garment, 0.02)
        p = tshirt_states._body_frame(mesh, garment, rng, False, 0.0, 0.0)
        q = p
        for fold in tshirt_states.fold_plan(state, way, garment, rng):
            q = tshirt_states.apply(fold, q, mesh, garment)
        return 2 * garment.cut["half_width"], garment.cut["length"], np.ptp(q[:, :2], axis=0)

    def test_a_round_has_the_papers_number_of_each_state(self):
        self.assertEqual(len(tshirt_states.ROUND), 44)
        self.assertEqual([tshirt_states.ROUND.count(s) for s in tshirt_states.STATES], [4, 12, 9, 4, 10, 5])

    def test_folds_give_the_shapes_of_their_states(self):
        for seed in range(3):
            for way in ("thirds", "quarter"):
                width, length, box = self.folded("strip", way, seed)
                self.assertLess(box[0], 0.6 * width)
                self.assertGreater(box[1], 0.95 * length)
            width, length, box = self.folded("fold-s", "half", seed)
            self.assertLess(box[0], 0.95 * width)
            self.assertLess(box[1], 0.8 * length)
            width, length, box = self.folded("fold-2", "half", seed)
            self.assertGreater(box[0], 0.9 * width)
            self.assertLess(box[1], 0.8 * length)
            for way in ("quarter", "shop-half"):
                width, length, box = self.folded("fold-4", way, seed)
                self.assertLess(box[0], 0.95 * width)
                self.assertLess(box[1], 0.8 * length)

    def test_rolling_over_lays_the_flap_on_what_is_below(self):
        x, y = np.meshgrid(np.linspace(-0.3, 0.3, 61), np.linspace(-0.2, 0.2, 41))
        p = np.c_[x.ravel(), y.ravel(), np.full(x.size, 0.01)]
        q = tshirt_states.roll_over(p, np.ones(len(p), bool), np.array([0.1, 0.0]), np.array([1.0, 0.0]))
        flap = p[:, 0] > 0.15
        np.testing.assert_array_equal(q[p[:, 0] <= 0.1], p[p[:, 0] <= 0.1])
        self.assertGreater(q[flap, 2].min(), 0.01 + tshirt_states.RADIUS)
        np.testing.assert_allclose(q[flap, 0], 0.2 - p[flap, 0], atol=4 * tshirt_states.RADIUS)
        self.assertLess(q[:, 0].max(), 0.1 + 2 * tshirt_states.RADIUS)

    def test_same_seed_same_bytes(self):
        contents = []
        before = sys.argv
        for _ in range(2):
            with tempfile.TemporaryDirectory() as out:
                sys.argv = ["blender", "--", "--out", out, "--seed", "3", "--index", "1", "--state", "fold-2", "--vertices", "500"]
                try:
                    tshirts.start()
                finally:
                    sys.argv = before
                contents.append({n: read(os.path.join(out, n)) for n in os.listdir(out)})
                header, _ = wsim.read(os.path.join(out, "3-00001.wsim"))
        self.assertEqual(contents[0], contents[1])
        self.assertEqual((header["garment"], header["state"]), ("tshirt", "fold-2"))


class Checks(unittest.TestCase):
    def test_crossing_triangles_are_counted_and_neighbours_are_not(self):
        p = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.3, 0.2, 1], [0.2, 0.3, 1], [1, 1, 0]], float)
        crossing = np.array([[0, 1, 2], [3, 4, 5], [1, 6, 2]])
        self.assertEqual(checks.intersecting_pairs(p, crossing), 1)
        self.assertEqual(checks.intersecting_pairs(p, crossing[[0, 2]]), 0)

    def test_wrinkledness_of_a_slope_is_its_angle(self):
        p = np.array([[0, 0, 0], [0.02, 0, 0.02], [0.02, 0.02, 0.02], [0, 0.02, 0]], float)
        self.assertAlmostEqual(checks.wrinkledness(p, np.array([[0, 1, 2], [0, 2, 3]])), 45.0, places=4)


def box(low, high):
    """Vertices and outward faces of an axis-aligned box."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    return np.array(low) + corners * (np.array(high) - np.array(low)), faces


def joined(*meshes_):
    vertices, faces = [], []
    for v, f in meshes_:
        faces.append(f + sum(len(x) for x in vertices))
        vertices.append(v)
    return np.concatenate(vertices), np.concatenate(faces)


class CheckedSets(unittest.TestCase):
    def faults(self, vertices, faces):
        return " ".join(check_states.mesh_faults(vertices, faces, 40, np.random.default_rng(1)))

    def test_faults_of_meshes_are_found(self):
        one = box((0, 0, 0), (0.3, 0.2, 0.1))
        other = box((0.4, 0, 0), (0.6, 0.2, 0.1))
        self.assertEqual(self.faults(*one), "")
        self.assertEqual(self.faults(*joined(one, other)), "")
        self.assertIn("edges", self.faults(one[0], one[1][1:]))
        self.assertIn("edges", self.faults(one[0], np.r_[one[1][:1, ::-1], one[1][1:]]))
        inside_out = one[0], one[1][:, ::-1]
        self.assertIn("inside out", self.faults(*inside_out))
        self.assertIn("winding number is -1", self.faults(*inside_out))
        crossing = self.faults(*joined(one, box((0.2, 0.05, 0.05), (0.5, 0.15, 0.3))))
        self.assertIn("pairs of faces intersect", crossing)
        hollow = box((0.1, 0.05, 0.03), (0.2, 0.1, 0.06))
        self.assertIn("hollows", self.faults(*joined(one, (hollow[0], hollow[1][:, ::-1]))))

    def test_faults_of_coco_files_are_found(self):
        np.testing.assert_array_equal(np.argwhere(check_states.decode_rle("516", 4, 3)), [[1, 1]])
        labels = np.zeros((4, 3), np.uint8)
        labels[1, 1] = 1
        annotation = {"id": 1, "image_id": 1, "category_id": 1, "label": 1, "area": 1, "bbox": [1, 1, 1, 1], "segmentation": {"size": [4, 3], "counts": "516"}}

        def faults(**changes):
            coco = {"images": [{"id": 1, "file_name": "a.png"}], "annotations": [{**annotation, **changes}], "categories": [{"id": 1, "name": "flat"}, {"id": 7, "name": "desk"}]}
            return " ".join(check_states.coco_faults(coco, lambda _: labels))

        self.assertEqual(faults(), "")
        self.assertIn("area or box", faults(area=2))
        self.assertIn("area or box", faults(bbox=[1, 1, 2, 1]))
        self.assertIn("mask", faults(segmentation={"size": [4, 3], "counts": "0<"}))
        self.assertIn("desk", faults(category_id=7))


class Files(unittest.TestCase):
    def run_main(self, out, *more):
        before = sys.argv
        sys.argv = ["blender", "--", "--out", out, "--seed", "5", "--garments", "towel", *more]
        try:
            main.main()
        finally:
            sys.argv = before

    def test_same_seed_same_bytes_and_another_index_another_towel(self):
        with tempfile.TemporaryDirectory() as a, tempfile.TemporaryDirectory() as b:
            for folder, index in ((a, 0), (a, 1), (b, 1)):
                self.run_main(folder, "--index", str(index), "--state-shares", "0,0,1,0")
            self.assertEqual(sorted(os.listdir(a)), ["5-00000.wsim", "5-00001.wsim"])
            self.assertEqual(os.listdir(b), ["5-00001.wsim"])
            first, second = (read(os.path.join(a, n)) for n in sorted(os.listdir(a)))
            self.assertNotEqual(first, second)
            self.assertEqual(read(os.path.join(b, "5-00001.wsim")), second)
            header, arrays = wsim.read(os.path.join(a, "5-00000.wsim"))
            self.assertEqual(arrays["pose"].shape, (header["quality"]["vertices"], 3))
            self.assertLess(arrays["faces"].max(), len(arrays["pose"]))
            self.assertGreaterEqual(arrays["pose"][:, 2].min(), 0)
            self.assertEqual((header["garment"], header["state"]), ("towel", "folded"))

    def test_rejected_poses_are_listed_with_their_reasons(self):
        before = checks.fault
        checks.fault = lambda *_: "too high"
        try:
            with tempfile.TemporaryDirectory() as a:
                self.run_main(a, "--index", "0", "--state-shares", "1,0,0,0", "--attempts", "2")
                self.assertEqual(os.listdir(a), ["5-00000.rejects.jsonl"])
                lines = [json.loads(x) for x in read(os.path.join(a, "5-00000.rejects.jsonl")).splitlines()]
                self.assertEqual([(x["attempt"], x["reason"]) for x in lines], [(0, "too high"), (1, "too high")])
        finally:
            checks.fault = before


if __name__ == "__main__":
    result = unittest.main(argv=["simulate_test"], exit=False, verbosity=2).result
    sys.stdout.flush()
    os._exit(0 if result.wasSuccessful() and result.testsRun else 1)
