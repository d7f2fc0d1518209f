"""Inducing points by greedy choice and exchange (what pingmap does) against those that the paper cites and does not use:
k-determinantal point processes and ridge leverage scores. Prints the table of docs/evaluation.md:

    python3 docs/evaluation/points.py

Every vehicle of the three trials by itself, first of the fixed splits, the kernel of the paper's experiment (squared
exponential on standardised positions, length-scale 1.092), ω by mean field; mean over vehicles and 50 draws.
"""

import pathlib

import numpy as np

import baselines
from process import gram, mean_field

DATA = pathlib.Path("crates/trial/data")
TRIALS = ("bay2", "lake2", "bay3")
LENGTH_SCALE = 1.092
DRAWS = 50


def trace_left(k, chosen):
    kzz = k[np.ix_(chosen, chosen)] + 1e-10 * np.eye(len(chosen))
    return len(k) - np.trace(np.linalg.solve(kzz, k[chosen] @ k[:, chosen]))


def greedy_exchange(k, points):
    chosen = []
    for _ in range(points):
        rest = [n for n in range(len(k)) if n not in chosen]
        chosen.append(min(rest, key=lambda n: trace_left(k, chosen + [n])))
    improved = True
    while improved:
        improved = False
        for place in range(points):
            kept = chosen[:place] + chosen[place + 1 :]
            rest = [n for n in range(len(k)) if n not in kept]
            best = min(rest, key=lambda n: trace_left(k, kept + [n]))
            if trace_left(k, kept + [best]) < trace_left(k, chosen) - 1e-9:
                chosen, improved = kept[:place] + [best] + kept[place:], True
    return chosen


def k_dpp(values, vectors, points, rng):
    """Kulesza and Taskar (2011): eigenvectors by elementary symmetric polynomials, then points one after the other."""
    n = len(values)
    e = np.zeros((points + 1, n + 1))
    e[0] = 1
    for k in range(1, points + 1):
        for m in range(1, n + 1):
            e[k, m] = e[k, m - 1] + values[m - 1] * e[k - 1, m - 1]
    basis, left = [], points
    for m in range(n, 0, -1):
        if left and rng.random() < values[m - 1] * e[left - 1, m - 1] / e[left, m]:
            basis.append(m - 1)
            left -= 1
    v, chosen = vectors[:, basis], []
    while v.shape[1]:
        weights = (v**2).sum(1)
        chosen.append(int(rng.choice(n, p=weights / weights.sum())))
        pivot = np.argmax(abs(v[chosen[-1]]))
        v = np.delete(v - np.outer(v[:, pivot], v[chosen[-1]] / v[chosen[-1], pivot]), pivot, 1)
        v = np.linalg.qr(v)[0] if v.shape[1] else v
    return chosen


def leverage(k, omega, points, rng):
    """Drawn by the ridge leverage scores of the weighted kernel, without replacement."""
    root = np.sqrt(omega)
    weighted = root[:, None] * k * root
    scores = np.diag(np.linalg.solve(weighted + np.eye(len(k)), weighted))
    return list(rng.choice(len(k), points, replace=False, p=scores / scores.sum()))


def nll(x, y, omega, chosen, to, heard):
    z = x[chosen]
    kzz, kzn, kzt = gram(z, z, LENGTH_SCALE) + 1e-10 * np.eye(len(z)), gram(z, x, LENGTH_SCALE), gram(z, to, LENGTH_SCALE)
    total = np.linalg.inv(kzz + (kzn * omega) @ kzn.T)
    mean = kzt.T @ total @ (kzn @ (y - 0.5))
    variance = 1 - (kzt * np.linalg.solve(kzz, kzt)).sum(0) + (kzt * (total @ kzt)).sum(0)
    return baselines.nll(1 / (1 + np.exp(-mean / np.sqrt(1 + np.pi * variance / 8))), heard)


def main():
    rng = np.random.default_rng(1)
    print("| points | greedy and exchange | k-DPP | ridge leverage | uniform |\n|---|---|---|---|---|")
    for points in (1, 2, 5, 10):
        found = {name: [] for name in ("good", "k-dpp", "leverage", "uniform")}
        for trial in TRIALS:
            events = baselines.read_events(DATA / f"{trial}.csv")
            split = baselines.read_splits(DATA / f"{trial}.splits.csv")[0]
            place = (events["place"] - events["place"].mean(0)) / events["place"].std(0)
            for receiver in events["receiver"].T == 1:
                training, held_out = receiver & ~split, receiver & split
                x, y = place[training], events["heard"][training]
                k = gram(x, x, LENGTH_SCALE)
                omega = mean_field(k, y)
                values, vectors = np.linalg.eigh(k)
                values = values.clip(0)
                ways = {
                    "good": [greedy_exchange(k, points)],
                    "k-dpp": [k_dpp(values, vectors, points, rng) for _ in range(DRAWS)],
                    "leverage": [leverage(k, omega, points, rng) for _ in range(DRAWS)],
                    "uniform": [list(rng.choice(len(k), points, replace=False)) for _ in range(DRAWS)],
                }
                for name, draws in ways.items():
                    share = np.mean([trace_left(k, chosen) / len(k) for chosen in draws])
                    loss = [nll(x, y, omega, chosen, place[held_out], events["heard"][held_out]) for chosen in draws]
                    found[name].append((share, np.mean(loss)))
        cells = [f"{share:.3f}, {loss:.3f}" for share, loss in (np.mean(all, 0) for all in found.values())]
        print(f"| {points} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
