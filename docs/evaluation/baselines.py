"""What a good engineer would try instead, on the same splits: logistic regression on the distance, and gradient boosting
tuned within the training events.

    python3 baselines.py EVENTS.csv SPLITS.csv            every baseline: mean NLL over the splits, and its error
    python3 baselines.py EVENTS.csv SPLITS.csv --distance  the distance alone, which pingmap's tables have too

SPLITS.csv has one column a split and one row an event, 1 = held out: those of the trials, or what
`pingmap replay --write-splits` wrote.
"""

import csv
import math
import sys

import numpy as np
from sklearn.ensemble import GradientBoostingClassifier

FOLDS = 3
DEPTHS = (2, 4)
TREES = 300
LEARNING_RATE = 0.05


def read_events(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    ends = ("tx_easting_m", "tx_northing_m", "rx_easting_m", "rx_northing_m")
    receivers = sorted({row["rx_id"] for row in rows})
    return {
        "place": np.array([[float(row[end]) for end in ends] for row in rows]),
        "heard": np.array([int(row["success"]) for row in rows]),
        "time": np.array([float(row["time_s"]) for row in rows]),
        "receiver": np.array([[row["rx_id"] == receiver for receiver in receivers] for row in rows], float),
    }


def read_splits(path):
    with open(path, newline="") as file:
        rows = list(csv.reader(file))
    return np.array(rows[1:], int).T == 1


def nll(probability, heard):
    probability = np.clip(probability, 1e-12, 1 - 1e-12)
    return float(-np.mean(np.where(heard == 1, np.log(probability), np.log1p(-probability))))


def estimate(values, splits):
    """Mean over splits and its error, corrected for their overlap (Nadeau and Bengio 2003)."""
    values = np.asarray(values)
    test_share = np.mean([split.sum() / (~split).sum() for split in splits])
    if len(values) < 2:
        return float(values.mean()), math.nan
    return float(values.mean()), float(math.sqrt(values.var(ddof=1) * (1 / len(values) + test_share)))


def distance_only(events, split):
    """Logistic regression on range over mean range, by Newton's method: precision .01 on the slope, 1e-4 on the intercept."""
    place, heard = events["place"], events["heard"]
    range_m = np.hypot(place[:, 0] - place[:, 2], place[:, 1] - place[:, 3])
    inputs = np.column_stack([np.ones(len(heard)), range_m / range_m[~split].mean()])
    x, y = inputs[~split], heard[~split]
    precision, weights = np.array([1e-4, 1e-2]), np.zeros(2)
    for _ in range(100):
        p = 1 / (1 + np.exp(-x @ weights))
        gradient = x.T @ (y - p) - precision * weights
        weights += np.linalg.solve((x.T * (p * (1 - p))) @ x + np.diag(precision), gradient)
    return 1 / (1 + np.exp(-inputs[split] @ weights))


def features(events, knows_receiver_and_time):
    place = events["place"]
    range_m = np.hypot(place[:, 0] - place[:, 2], place[:, 1] - place[:, 3])
    columns = [place, range_m[:, None]]
    if knows_receiver_and_time:
        columns += [events["receiver"], events["time"][:, None]]
    return np.column_stack(columns)


def with_reversed_copies(x, y):
    """Every link also the other way round: the two directions of a path behave alike, or nearly."""
    return np.vstack([x, x[:, [2, 3, 0, 1, *range(4, x.shape[1])]]]), np.concatenate([y, y])


def staged(x, y, to, depth, is_reversed, seed=1):
    """Probabilities after every tree."""
    if is_reversed:
        x, y = with_reversed_copies(x, y)
    model = GradientBoostingClassifier(
        n_estimators=TREES, learning_rate=LEARNING_RATE, max_depth=depth, subsample=0.7, random_state=seed
    )
    return [p[:, 1] for p in model.fit(x, y).staged_predict_proba(to)]


def boosting(events, split, knows_receiver_and_time):
    """Depth, number of trees and reversed copies by inner validation: folds of the training events in blocks of time."""
    x, y = features(events, knows_receiver_and_time), events["heard"]
    training = np.flatnonzero(~split)
    in_time = training[np.argsort(events["time"][training], kind="stable")]
    folds = [np.concatenate(np.array_split(in_time, 4 * FOLDS)[fold::FOLDS]) for fold in range(FOLDS)]
    best = (math.inf, None)
    for depth in DEPTHS:
        for is_reversed in (False, True):
            losses = np.zeros(TREES)
            for fold in folds:
                rest = np.setdiff1d(training, fold)
                losses += [nll(p, y[fold]) for p in staged(x[rest], y[rest], x[fold], depth, is_reversed)]
            trees = int(losses.argmin())
            best = min(best, (losses[trees], (depth, is_reversed, trees)), key=lambda pair: pair[0])
    depth, is_reversed, trees = best[1]
    return staged(x[training], y[training], x[split], depth, is_reversed)[trees]


BASELINES = {
    "distance only": distance_only,
    "boosting": lambda events, split: boosting(events, split, False),
    "boosting, with receiver and time": lambda events, split: boosting(events, split, True),
}


def losses(events, splits, method):
    return [nll(method(events, split), events["heard"][split]) for split in splits]


def main():
    events, splits = read_events(sys.argv[1]), read_splits(sys.argv[2])
    for name, method in BASELINES.items():
        if "--distance" in sys.argv and name != "distance only":
            continue
        mean, error = estimate(losses(events, splits, method), splits)
        print(f"{name:34} {mean:.4f} ± {error:.4f}")


if __name__ == "__main__":
    main()
