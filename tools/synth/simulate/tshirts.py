"""Simulate one T-shirt in one of six states and write it as a .wsim file. Run by Blender, by `weft synth states`:

OMP_NUM_THREADS=1 blender -b --factory-startup -t 1 -P tools/synth/simulate/tshirts.py -- --out DIR --seed S --index I

States come round as often as in the garment SLAM paper: 4 flat, 12 strip, 9 stack, 4 fold-2, 10 fold-4 and 5 fold-s of
44, each round in an order of its own. Randomness and files are those of main.py.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

import cloth
import main
import mesh as meshes
import patterns
import tshirt_states

FAMILIES = ("crew", "crew", "scoop", "v-neck", "long-sleeve")
VERTICES = 2600  # folds lie in eight and more layers, whose contacts cost most


def arguments():
    parser = main.common_arguments("tshirts", "simulate a T-shirt in one of six states", VERTICES)
    parser.add_argument("--state", choices=tshirt_states.STATES, help="this state instead of the round's")
    return main.parse(parser)


def plan(args):
    n = len(tshirt_states.ROUND)
    order = np.random.default_rng([args.seed, args.index // n, 1]).permutation(n)
    return args.state or tshirt_states.ROUND[order[args.index % n]]


def simulate(args, attempt, kind, state):
    """(header, arrays, reason for rejecting it or None)."""
    rng = np.random.default_rng([args.seed, args.index, 1 + attempt])
    garment = patterns.cut(kind, str(rng.choice(FAMILIES)), rng, False)
    turned_over = bool(rng.random() < 0.5)
    fabric = cloth.draw_fabric(rng)
    h = max(0.0125, meshes.edge_length(garment, args.vertices))
    mesh = meshes.build(garment, h, 2.5 * cloth.SPACING, rng)
    raw, how = tshirt_states.lie(mesh, garment, fabric, state, turned_over, rng)
    return main.describe(args, attempt, garment, fabric, mesh, state, how, turned_over, raw)


def start():
    args = arguments()
    main.make(args, "tshirt", plan(args), simulate)


if __name__ == "__main__":
    main.run(start)
