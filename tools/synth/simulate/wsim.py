"""Writing and reading .wsim files (docs/simulation-format.md)."""
import json
import os

import numpy as np

GENERATOR = "weft-cloth 6"


def _plain(x):
    if isinstance(x, np.ndarray):
        return _plain(x.tolist())
    if isinstance(x, dict):
        return {k: _plain(v) for k, v in x.items()}
    if isinstance(x, (list, tuple)):
        return [_plain(v) for v in x]
    if isinstance(x, (float, np.floating)):
        return round(float(x), 5)
    if isinstance(x, np.integer):
        return int(x)
    return x


def write(path, header, arrays):
    """arrays: {name: (dtype, array)} in file order. The file appears whole or not at all."""
    converted = {n: np.ascontiguousarray(a, "<" + d if d != "u1" else d) for n, (d, a) in arrays.items()}
    header = dict(header)
    header["arrays"] = [{"name": n, "dtype": arrays[n][0], "shape": list(a.shape)} for n, a in converted.items()]
    part = path + ".tmp"
    with open(part, "wb") as f:
        f.write(json.dumps(_plain(header), separators=(",", ":")).encode() + b"\n")
        for a in converted.values():
            f.write(a.tobytes())
    os.replace(part, path)


def read(path):
    with open(path, "rb") as f:
        header = json.loads(f.readline())
        arrays = {}
        for a in header["arrays"]:
            dtype = np.dtype(a["dtype"]).newbyteorder("<")
            count = int(np.prod(a["shape"]))
            arrays[a["name"]] = np.frombuffer(f.read(count * dtype.itemsize), dtype).reshape(a["shape"])
    return header, arrays
