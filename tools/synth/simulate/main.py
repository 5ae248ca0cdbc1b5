"""Simulate one garment on a table and write it as a .wsim file. Run by Blender, best by `weft synth parts`:

OMP_NUM_THREADS=1 blender -b --factory-startup -t 1 -P tools/synth/simulate/main.py -- --out DIR --seed S --index I

The randomness of an index depends on (seed, index) alone: the same seed gives the same bytes. A pose may be
rejected; the next attempt draws everything anew. S-I.rejects.jsonl holds a line with the reason for each, S-I.wsim
the pose that is good, if there is one.
"""
import argparse
import json
import os
import sys
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


def names(text):
    found = text.split(",")
    for name in found:
        if name not in patterns.GARMENTS:
            raise argparse.ArgumentTypeError(f"{name}: not one of {' '.join(sorted(patterns.GARMENTS))}")
    return found


def shares(text):
    found = [float(x) for x in text.split(",")]
    if len(found) != len(states.STATES) or min(found) < 0 or abs(sum(found) - 1) > 1e-9:
        raise argparse.ArgumentTypeError(f"{text}: not {len(states.STATES)} shares that add up to 1")
    return found


def common_arguments(prog, description, vertices):
    """A parser of what every simulating script takes."""
    parser = argparse.ArgumentParser(prog=prog, description=description)
    parser.add_argument("--out", required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--index", type=int, required=True)
    parser.add_argument("--vertices", type=int, default=vertices)
    parser.add_argument("--attempts", type=int, default=3)
    return parser


def parse(parser):
    """The arguments after Blender's own `--`."""
    args = parser.parse_args(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
    if args.index < 0 or args.seed < 0 or args.attempts < 1:
        parser.error("--index and --seed must not be negative, --attempts at least 1")
    if os.environ.get("OMP_NUM_THREADS") != "1":
        parser.error("set OMP_NUM_THREADS=1: with more threads the result changes from run to run")
    return args


def arguments():
    parser = common_arguments("simulate", "simulate a garment on a table", 4600)
    parser.add_argument("--garments", type=names, default=list(ROUND), help="types, in a new order each round")
    parser.add_argument("--state-shares", type=shares, default=list(states.SHARES), help=" ".join(states.STATES))
    parser.add_argument("--held-out-share", type=float, default=0.25)
    parser.add_argument("--turned-over-share", type=float, default=0.3)
    return parse(parser)


def plan(args):
    """(garment, state): types come round equally, in an order of their own each round."""
    n = len(args.garments)
    order = np.random.default_rng([args.seed, args.index // n]).permutation(n)
    rng = np.random.default_rng([args.seed, args.index, 0])
    return args.garments[order[args.index % n]], str(rng.choice(states.STATES, p=args.state_shares))


def simulate(args, attempt, kind, state):
    """(header, arrays, reason for rejecting it or None)."""
    rng = np.random.default_rng([args.seed, args.index, 1 + attempt])
    held_out = bool(rng.random() < args.held_out_share)
    garment = patterns.draw(kind, rng, held_out)
    turned_over = bool(rng.random() < args.turned_over_share)
    fabric = cloth.draw_fabric(rng)
    single = len(garment.panels) == 1
    # Piles have the most contacts: a coarser mesh keeps their cost near that of the others.
    coarse = 1.15 if state == "crumpled" else 1.0
    h = coarse * min(0.0145, max(0.0115, meshes.edge_length(garment, args.vertices * (0.6 if single else 1.0))))
    mesh = meshes.build(garment, h, 2.5 * cloth.SPACING, rng)
    raw, how = states.lie(mesh, garment, fabric, state, turned_over, rng)
    return describe(args, attempt, garment, fabric, mesh, state, how, turned_over, raw)


def describe(args, attempt, garment, fabric, mesh, state, how, turned_over, raw):
    """(header, arrays, reason for rejecting it or None) of what the cloth simulation left."""
    if not np.isfinite(raw).all():
        return None, None, "not finite"
    p = checks.settle(raw)
    quality = checks.measure(mesh, p)
    header = {
        "format": "weft-sim",
        "version": 1,
        "seed": args.seed,
        "index": args.index,
        "attempt": attempt,
        "generator": wsim.GENERATOR,
        "garment": garment.kind,
        "family": garment.family,
        "split_cut": "held-out" if garment.held_out else "seen",
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


def write_text(path, text):
    with open(path + ".tmp", "w") as f:
        f.write(text)
    os.replace(path + ".tmp", path)


def make(args, kind, state, simulate):
    """Writes the index's files with what simulate(args, attempt, kind, state) returns."""
    os.makedirs(args.out, exist_ok=True)
    base = os.path.join(args.out, f"{args.seed}-{args.index:05d}")
    rejects = []
    for attempt in range(args.attempts):
        header, arrays, reason = simulate(args, attempt, kind, state)
        print(f"{args.index} {kind} {header and header['family']} {state} {header and header['quality']} {reason or 'ok'}", flush=True)
        if reason is None:
            break
        rejects.append(json.dumps({"seed": args.seed, "index": args.index, "attempt": attempt, "garment": kind, "state": state, "reason": reason, "quality": header and header["quality"]}) + "\n")
    # The .wsim file says that an index is done: what belongs to it comes before.
    if rejects:
        write_text(base + ".rejects.jsonl", "".join(rejects))
    if len(rejects) < args.attempts:
        wsim.write(base + ".wsim", header, arrays)


def main():
    args = arguments()
    make(args, *plan(args), simulate)


def run(function):
    try:
        function()
    except SystemExit as e:
        os._exit(e.code if isinstance(e.code, int) else 1)
    except Exception:
        # Blender would report a failed script and still exit with 0.
        traceback.print_exc()
        os._exit(1)


if __name__ == "__main__":
    run(main)
