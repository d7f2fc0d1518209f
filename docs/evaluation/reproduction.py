"""Recomputes rows of docs/reproduction.md from the log alone, in a few lines of NumPy that share nothing with pingmap but the
divisions: every agent of a trial by itself, good points and all events, ω by mean field (the last column).

    python3 docs/evaluation/reproduction.py bay3
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

import baselines
from process import gram, mean_field

DATA = pathlib.Path("crates/trial/data")
PINGMAP = pathlib.Path("target/release/pingmap")
RADIUS_LENGTH_SCALES = 1.384
PERMUTATIONS = 100
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(60)


def divisions(trial):
    """The divisions of `pingmap reproduce --seed 1` are the first random splits of that seed."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "splits.csv"
        log = DATA / f"{trial}.csv"
        options = ["--repeats", PERMUTATIONS, "--frames", 1, "--length-scale-m", 500, "--variance", 4, "--write-splits", path]
        subprocess.run([PINGMAP, "replay", log, *map(str, options)], check=True, capture_output=True)
        return baselines.read_splits(path)


def length_scale():
    done = subprocess.run([PINGMAP, "reproduce", "events", "--json"], check=True, capture_output=True, text=True)
    return json.loads(done.stdout)["length_scale"]


def good_points(k, points):
    """The one or two of smallest tr K̃, by looking at all of them."""
    c = k @ k
    if points == 1:
        return [int(np.argmax(np.diag(c)))]
    with np.errstate(divide="ignore", invalid="ignore"):
        lowered = (np.diag(c)[:, None] + np.diag(c)[None, :] - 2 * k * c) / (1 - k**2)
    lowered[1 - k**2 < 1e-4] = -np.inf
    return list(np.unravel_index(np.argmax(lowered), lowered.shape))


def nll(mean, variance, heard):
    f = mean[:, None] + np.sqrt(variance)[:, None] * NODES
    return baselines.nll((WEIGHTS / WEIGHTS.sum() / (1 + np.exp(-f))).sum(1), heard)


def told(x, y, omega, z, to, heard, scale):
    """Prediction from the variational summary at z."""
    kzz, kzn, kzt = gram(z, z, scale), gram(z, x, scale), gram(z, to, scale)
    total = kzz + (kzn * omega) @ kzn.T
    mean = kzt.T @ np.linalg.solve(total, kzn @ (y - 0.5))
    variance = 1 - (kzt * np.linalg.solve(kzz, kzt)).sum(0) + (kzt * np.linalg.solve(total, kzt)).sum(0)
    return nll(mean, variance, heard)


def everything(x, y, omega, to, heard, scale):
    k, kt = gram(x, x, scale), gram(x, to, scale)
    noisy = k + np.diag(1 / omega)
    mean = kt.T @ np.linalg.solve(noisy, (y - 0.5) / omega)
    return nll(mean, 1 - (kt * np.linalg.solve(noisy, kt)).sum(0), heard)


def main():
    trial = sys.argv[1]
    events, splits, scale = baselines.read_events(DATA / f"{trial}.csv"), divisions(trial), length_scale()
    place = (events["place"] - events["place"].mean(0)) / events["place"].std(0)
    radius = RADIUS_LENGTH_SCALES * scale
    for agent, owns in enumerate(events["receiver"].T == 1):
        own = np.flatnonzero(owns)
        near = ((place[own][:, None] - place[own][None]) ** 2).sum(-1) <= radius**2
        region = np.zeros(len(owns), bool)
        region[own[near[near.sum(1).argmax()]]] = True
        losses = {"one good": [], "two good": [], "all events": []}
        for split in splits:
            training, held_out = region & ~split, region & split
            if not training.any() or not held_out.any():
                continue
            x, y, to, heard = place[training], events["heard"][training], place[held_out], events["heard"][held_out]
            k = gram(x, x, scale)
            omega = mean_field(k, y)
            for points, name in ((1, "one good"), (2, "two good")):
                losses[name].append(told(x, y, omega, x[good_points(k, points)], to, heard, scale))
            losses["all events"].append(everything(x, y, omega, to, heard, scale))
        for name, values in losses.items():
            error = np.std(values, ddof=1) / np.sqrt(len(values))
            print(f"agent {agent + 1}, {name:10} {np.mean(values):.4f} ± {error:.4f}", flush=True)


if __name__ == "__main__":
    main()
