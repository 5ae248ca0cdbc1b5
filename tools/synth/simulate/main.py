"""Simulate garments on a table, one .wsim file each. Run by Blender:

OMP_NUM_THREADS=1 blender -b --factory-startup -P tools/synth/simulate/main.py -- \\
    --out DIR --first-index I --count N --seed S [--offset K --stride J]

The randomness of an index depends on (seed, index) alone: the same seed gives the same bytes. What is
finished is not done again. --offset K --stride J takes every J-th index from the K-th on, so that J
processes can share the work. Rejected poses go to rejects.jsonl with their reason; an index is tried
up to three times.
"""
import argparse
import json
import os
import sys
import time
import traceback

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

import checks
import cloth
import mesh as meshes
import patterns
import states
import wsim

ROUND = ("tshirt", "polo", "jeans", "shirt", "sweater", "dress") * 3 + ("towel", "blanket")
ATTEMPTS = 3
VERTICES = 4600
HELD_OUT_SHARE = 0.25


def arguments():
    parser = argparse.ArgumentParser(prog="simulate", description="simulate garments on a table")
    parser.add_argument("--out", required=True)
    parser.add_argument("--first-index", type=int, default=0)
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--offset", type=int, default=0)
    parser.add_argument("--stride", type=int, default=1)
    parser.add_argument("--garment", choices=sorted(patterns.GARMENTS), help="only this type")
    parser.add_argument("--state", choices=states.STATES, help="only this state")
    args = parser.parse_args(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
    if args.stride < 1 or not 0 <= args.offset < args.stride or args.count < 0 or args.first_index < 0 or args.seed < 0:
        parser.error("--count, --first-index and --seed must not be negative, and 0 <= --offset < --stride")
    if os.environ.get("OMP_NUM_THREADS") != "1":
        parser.error("set OMP_NUM_THREADS=1: with more threads the result changes from run to run")
    return args


def plan(seed, index, args):
    """(garment, state): types come round equally, in an order of their own each round."""
    order = np.random.default_rng([seed, index // len(ROUND)]).permutation(len(ROUND))
    rng = np.random.default_rng([seed, index, 0])
    kind = args.garment or ROUND[order[index % len(ROUND)]]
    return kind, args.state or str(rng.choice(states.STATES, p=states.SHARES))


def simulate(seed, index, attempt, kind, state):
    """(header, arrays, reason for rejecting it or None)."""
    rng = np.random.default_rng([seed, index, 1 + attempt])
    held_out = bool(rng.random() < HELD_OUT_SHARE)
    garment = patterns.draw(kind, rng, held_out)
    turned_over = bool(rng.random() < 0.3)
    fabric = cloth.draw_fabric(rng)
    single = len(garment.panels) == 1
    # Piles have the most contacts: a coarser mesh keeps their cost near that of the others.
    coarse = 1.15 if state == "crumpled" else 1.0
    h = coarse * min(0.0145, max(0.0115, meshes.edge_length(garment, VERTICES * (0.6 if single else 1.0))))
    mesh = meshes.build(garment, h, 2.5 * cloth.SPACING, rng)
    raw, how = states.lie(mesh, garment, fabric, state, turned_over, rng)
    if not np.isfinite(raw).all():
        return None, None, "not finite"
    p = checks.settle(raw)
    quality = checks.measure(mesh, p)
    header = {
        "format": "weft-sim",
        "version": 1,
        "seed": seed,
        "index": index,
        "attempt": attempt,
        "generator": wsim.GENERATOR,
        "garment": kind,
        "family": garment.family,
        "split_cut": "held-out" if held_out else "seen",
        "cut": garment.cut,
        "fabric": vars(fabric),
        "state": state,
        "how": how,
        "turned_over": turned_over,
        "wrinkledness": checks.wrinkledness(p, mesh.faces),
        "quality": quality,
        "panels": [{"name": q.name, "side": q.side, "layer": q.layer} for q in garment.panels],
        "edges": garment.edges(),
        "parts": garment.parts,
        "features": garment.features,
    }
    arrays = {"pattern": ("f4", mesh.pattern), "pose": ("f4", p), "faces": ("i4", mesh.faces), "panel": ("u1", mesh.panel)}
    return header, arrays, checks.fault(raw, p, quality, state)


def main():
    args = arguments()
    os.makedirs(args.out, exist_ok=True)
    rejects = os.path.join(args.out, "rejects.jsonl")
    known, given_up = set(), set()
    if os.path.exists(rejects):
        for line in open(rejects):
            if line.endswith("\n"):
                r = json.loads(line)
                known.add((r["seed"], r["index"], r["attempt"]))
    given_up = {(s, i) for s, i, a in known if a == ATTEMPTS - 1}
    indices = range(args.first_index + args.offset, args.first_index + args.count, args.stride)
    path = lambda i: os.path.join(args.out, f"{args.seed}-{i:05d}.wsim")
    todo = [i for i in indices if not os.path.exists(path(i)) and (args.seed, i) not in given_up]
    print(f"simulate: {len(indices)} indices, {len(indices) - len(todo)} done before", flush=True)
    start, made, refused = time.monotonic(), 0, 0
    for n, index in enumerate(todo, 1):
        kind, state = plan(args.seed, index, args)
        for attempt in range(ATTEMPTS):
            if (args.seed, index, attempt) in known:
                continue
            cpu = time.process_time()
            header, arrays, reason = simulate(args.seed, index, attempt, kind, state)
            cpu = time.process_time() - cpu
            if reason is None:
                wsim.write(path(index), header, arrays)
                made += 1
            else:
                record = {"seed": args.seed, "index": index, "attempt": attempt, "garment": kind, "state": state, "reason": reason, "quality": header and header["quality"]}
                with open(rejects, "a") as f:
                    f.write(json.dumps(record) + "\n")
                refused += 1
            print(f"  {index} {kind} {header and header['family']} {state} {header and header['how']} {header and header['quality']} {cpu:.1f} s {reason or 'ok'}", flush=True)
            if reason is None:
                break
        elapsed = time.monotonic() - start
        print(f"simulate: {n}/{len(todo)} made {made} rejected {refused}, {elapsed / n:.1f} s each, {elapsed / n * (len(todo) - n) / 60:.0f} min left", flush=True)


if __name__ == "__main__":
    try:
        main()
    except SystemExit as e:
        os._exit(e.code if isinstance(e.code, int) else 1)
    except Exception:
        # Blender would report a failed script and still exit with 0.
        traceback.print_exc()
        os._exit(1)
