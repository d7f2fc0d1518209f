"""Compares the estimator with scikit-learn's on five public data sets.

    PINGMAP_SHARED=folder python examples/compare.py

The folder `data/classification` there has the sets, and `splits` in it the rows of five random splits of each. Both
sides use one thread, the same splits, and start from the same kernel: a constant times an isotropic RBF.
"""

import os
import sys
import time
import warnings
from pathlib import Path

for name in ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS"]:
    os.environ[name] = "1"

import dgpc  # noqa: E402
import numpy as np  # noqa: E402
from sklearn.gaussian_process import GaussianProcessClassifier as Laplace  # noqa: E402
from sklearn.gaussian_process.kernels import RBF, ConstantKernel  # noqa: E402
from sklearn.metrics import log_loss  # noqa: E402

SETS = ["banana", "pima", "statlog-german-credit", "ringnorm", "statlog-heart"]


def read(folder: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns inputs and outcomes of a set."""
    table = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=int(name == "banana"))
    return table[:, :-1], table[:, -1] == table[:, -1].max()


def splits(folder: Path, name: str, count: int) -> list[list[np.ndarray]]:
    """Returns the training and test rows of five splits; those of a set without files are drawn with seeds 0 to 4."""

    def rows(split: int) -> list[np.ndarray]:
        files = [folder / "splits" / f"{name}_s{split}_{part}_idx.csv" for part in ["train", "test"]]
        if files[0].exists():
            return [np.loadtxt(file, dtype=int) for file in files]
        order = np.random.default_rng(split).permutation(count)
        return [order[:400], order[400:]]

    return [rows(split) for split in range(5)]


def scores(model: object, train: tuple, test: tuple) -> list[float]:
    """Returns NLL in nats, accuracy, and CPU time of the fit in seconds."""
    begin = time.process_time()
    model.fit(*train)
    taken = time.process_time() - begin
    probability = model.predict_proba(test[0])[:, 1]
    return [log_loss(test[1], probability, labels=[False, True]), np.mean((probability > 0.5) == test[1]), taken]


def models(columns: int) -> list[object]:
    """Returns both estimators with the same kernel."""
    kernel = ConstantKernel(1.0) * RBF(np.sqrt(columns))
    return [dgpc.GaussianProcessClassifier(kernel), Laplace(kernel)]


def standardised(x: np.ndarray, train: np.ndarray) -> np.ndarray:
    """Returns inputs that have mean 0 and standard deviation 1 over the training rows."""
    mean, deviation = x[train].mean(axis=0), x[train].std(axis=0)
    return (x - mean) / np.where(deviation > 0.0, deviation, 1.0)


def compare_times(folder: Path) -> None:
    """Prints the CPU time of fits of 1000 random rows, in five pairs of runs."""
    print("\n| 1000 rows of | CPU time in s | ratio: median, smallest, largest |")
    print("|---|---|---|")
    for name in ["banana", "ringnorm"]:
        x, y = read(folder, name)
        pairs = []
        for seed in range(5):
            rows = np.random.default_rng(seed).permutation(len(y))[:1000]
            data = (standardised(x, rows)[rows], y[rows])
            pairs.append([scores(model, data, data)[2] for model in models(x.shape[1])])
        ours, theirs = np.array(pairs).T
        ratios = theirs / ours
        print(
            f"| {name} | {np.median(ours):.2f}, {np.median(theirs):.2f} | "
            f"{np.median(ratios):.1f}, {ratios.min():.1f}, {ratios.max():.1f} |",
            flush=True,
        )


def main() -> None:
    if "PINGMAP_SHARED" not in os.environ:
        sys.exit("PINGMAP_SHARED must name the folder with data/classification")
    folder = Path(os.environ["PINGMAP_SHARED"]) / "data" / "classification"
    # scikit-learn warns of optima at the bounds of its kernels.
    warnings.simplefilter("ignore")
    print("| set | N | NLL dgpc | NLL scikit-learn | difference | accuracy | CPU time in s |")
    print("|---|---|---|---|---|---|---|")
    for name in SETS:
        x, y = read(folder, name)
        found, sizes = [], (0, 0)
        for train, test in splits(folder, name, len(y)):
            scaled = standardised(x, train)
            data = [(scaled[rows], y[rows]) for rows in [train, test]]
            found.append([scores(model, *data) for model in models(x.shape[1])])
            sizes = (len(train), len(test))
        ours, theirs = np.array(found).transpose(1, 2, 0)
        difference = ours[0] - theirs[0]
        # The splits overlap: the variance of their mean is that of Nadeau and Bengio.
        error = np.sqrt((1 / len(found) + sizes[1] / sizes[0]) * difference.var(ddof=1))
        print(
            f"| {name} | {sizes[0]} | {ours[0].mean():.4f} | {theirs[0].mean():.4f} | "
            f"{difference.mean():+.4f} ± {error:.4f} | {ours[1].mean():.3f}, {theirs[1].mean():.3f} | "
            f"{ours[2].mean():.2f}, {theirs[2].mean():.2f} |",
            flush=True,
        )
    compare_times(folder)


if __name__ == "__main__":
    main()
