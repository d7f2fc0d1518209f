"""All tables of README.md and docs/evaluation.md that compare methods, on the three trials that come with pingmap:

    cargo build --release -p pingmap
    pip install -r docs/evaluation/requirements.txt
    python3 docs/evaluation/evaluate.py > tables.md

from the folder of the repository; about half an hour on two cores. Every method sees the same splits.
"""

import json
import pathlib
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor

import baselines

TRIALS = ("bay2", "lake2", "bay3")
# The model of a vehicle that has been elsewhere was learned from another trial.
ELSEWHERE = {"bay2": "lake2", "lake2": "bay3", "bay3": "bay2"}
DATA = pathlib.Path("crates/trial/data")
PINGMAP = pathlib.Path("target/release/pingmap")
FRAMES = (1, 5, 10)
# Of ten splits, at 5 %.
STUDENT_T = {10: 2.262}
PROTOCOLS = {"random": "splits", "blocks of time": "time.splits", "farther ranges": "far.splits"}


def pingmap(*arguments):
    done = subprocess.run([PINGMAP, *map(str, arguments)], check=True, capture_output=True, text=True)
    return done.stdout


def replay(trial, protocol, *options):
    splits = DATA / f"{trial}.{PROTOCOLS[protocol]}.csv"
    frames = ",".join(map(str, FRAMES))
    return json.loads(pingmap("replay", DATA / f"{trial}.csv", "--splits", splits, "--frames", frames, "--json", *options))


def models(folder):
    """Options for who learned the model, for every trial."""
    for trial in TRIALS:
        pingmap("learn", DATA / f"{trial}.csv", "-o", folder / f"{trial}.toml")
    return {
        "elsewhere": lambda trial: ("--model", folder / f"{ELSEWHERE[trial]}.toml"),
        "each vehicle": lambda _: ("--learn", "own"),
        "pooled": lambda _: (),
    }


def baseline(job):
    trial, protocol, name = job
    events = baselines.read_events(DATA / f"{trial}.csv")
    splits = baselines.read_splits(DATA / f"{trial}.{PROTOCOLS[protocol]}.csv")
    return baselines.losses(events, splits, baselines.BASELINES[name])


def number(mean, error):
    if error != error or error is None:
        return f"{mean:.3f}".replace("0.", ".", 1)
    return f"{mean:.3f} ± {error:.3f}".replace("0.", ".")


def score(value):
    return number(value["nll"], value["nll_se"] if value["nll_se"] is not None else float("nan"))


def difference(value):
    mark = " ≈" if value["indistinguishable"] else ""
    return f"{value['nll']:+.4f} ± {value['nll_se']:.4f}{mark}".replace("0.", ".") if value["nll_se"] else "–"


def gap_closed(sharing):
    if sharing["gap_closed"] is None:
        return "–"
    return f"{100 * sharing['gap_closed']:.0f} ± {100 * sharing['gap_closed_se']:.0f} %"


def markdown(title, header, rows):
    print(f"**{title}**\n")
    print("| " + " | ".join(header) + " |\n|" + "---|" * len(header))
    for row in rows:
        print("| " + " | ".join(row) + " |")
    print(flush=True)


def nll_table(protocol, results, tried):
    """NLL of everybody, one row a method."""
    first = {trial: results[trial, protocol, "pooled"] for trial in TRIALS}
    splits = {trial: baselines.read_splits(DATA / f"{trial}.{PROTOCOLS[protocol]}.csv") for trial in TRIALS}
    rows = []
    for name in baselines.BASELINES:
        estimates = [baselines.estimate(tried[trial, protocol, name], splits[trial]) for trial in TRIALS]
        rows.append([name, *(number(*estimate) for estimate in estimates)])
    for model in ("elsewhere", "each vehicle", "pooled"):
        found = [results[trial, protocol, model] for trial in TRIALS]
        rows.append([f"alone, model learned {words(model)}", *(score(one["scores"]["own"]) for one in found)])
        for place, frames in enumerate(FRAMES):
            name = f"team, {frames} packet{'s' if frames > 1 else ''}, {words(model)}"
            rows.append([name, *(score(one["sharing"][place]["team"]) for one in found)])
        rows.append([f"all events in one place, {words(model)}", *(score(one["scores"]["centralised"]) for one in found)])
    rows.append(["true probabilities", *(score(one["scores"]["true_probability"]) for one in first.values())])
    markdown(f"NLL, {protocol}", ["", *TRIALS], rows)


def words(model):
    return {"elsewhere": "elsewhere", "each vehicle": "by each vehicle", "pooled": "from everybody's events"}[model]


def difference_table(protocol, results, tried):
    """Paired differences: what sharing is worth, what it leaves, and boosting against all events."""
    splits = {trial: baselines.read_splits(DATA / f"{trial}.{PROTOCOLS[protocol]}.csv") for trial in TRIALS}
    rows = []
    for model in ("elsewhere", "each vehicle", "pooled"):
        for trial in TRIALS:
            result = results[trial, protocol, model]
            last = result["sharing"][-1]
            ours = [split["nll"]["centralised"] for split in result["per_split"]]
            row = [f"{trial}, {words(model)}", difference(last["better_than_own"]), difference(last["worse_than_centralised"])]
            row.append(gap_closed(last))
            for name in ("distance only", "boosting", "boosting, with receiver and time"):
                theirs = tried[trial, protocol, name]
                mean, error = baselines.estimate([b - a for a, b in zip(ours, theirs)], splits[trial])
                is_clear = abs(mean) > STUDENT_T[len(theirs)] * error
                row.append(f"{mean:+.3f} ± {error:.3f}".replace("0.", ".") + ("" if is_clear else " ≈"))
            rows.append(row)
    header = ["", "alone − team", "team − all", "gap closed", "distance − all", "boosting − all", "boosting+ − all"]
    markdown(f"Paired differences of NLL after ten packets, {protocol}", header, rows)


def other_scores(protocol, results):
    rows = []
    for trial in TRIALS:
        result = results[trial, protocol, "elsewhere"]
        named = {"distance only": result["scores"]["distance_only"], "alone": result["scores"]["own"]}
        named |= {"team, 10 packets": result["sharing"][-1]["team"], "all events": result["scores"]["centralised"]}
        for name, value in named.items():
            cells = [f"{100 * value['acc']:.1f} %", f"{value['brier']:.4f}", f"{value['regret']:.4f} ± {value['regret_se']:.4f}"]
            rows.append([f"{trial}, {name}", *cells])
    markdown(f"Other scores, model learned elsewhere, {protocol}", ["", "accuracy", "Brier", "regret"], rows)


def calibration_table(protocol, results):
    rows = []
    for trial in TRIALS:
        calibration = results[trial, protocol, "elsewhere"]["calibration"]
        for name, key in (("alone", "own"), ("team, 10 packets", "team"), ("all events", "centralised")):
            of = calibration[key]
            shares = [f"{100 * of[key]:.0f} %" for key in ("coverage_50", "coverage_90")]
            surer = ["–", "–"]
            if key == "team":
                surer = [f"{100 * calibration['team_surer_than_centralised']:.0f} %", f"{calibration['median_variance_ratio']:.2f}"]
            rows.append([f"{trial}, {name}", f"{of['expected_error']:.3f}", *shares, *surer])
    header = ["", "expected calibration error", "truth in 50 % intervals", "in 90 % intervals", "surer than all events", "variance ratio"]
    markdown(f"Calibration, model learned elsewhere, {protocol}", header, rows)


def main():
    jobs = [(trial, protocol, name) for protocol in PROTOCOLS for trial in TRIALS for name in baselines.BASELINES]
    with ProcessPoolExecutor(2) as pool:
        tried = dict(zip(jobs, pool.map(baseline, jobs)))
    results = {}
    with tempfile.TemporaryDirectory() as folder:
        for model, options in models(pathlib.Path(folder)).items():
            for protocol in PROTOCOLS:
                for trial in TRIALS:
                    results[trial, protocol, model] = replay(trial, protocol, "--calibration", *options(trial))
                    print(f"{trial}, {protocol}, {model}", file=sys.stderr)
    for protocol in PROTOCOLS:
        nll_table(protocol, results, tried)
    for protocol in ("random", "blocks of time"):
        difference_table(protocol, results, tried)
        other_scores(protocol, results)
        calibration_table(protocol, results)


if __name__ == "__main__":
    main()
