"""The paper's experiment with two agents, and its figure.

    python examples/two_agents.py docs/two_agents.png

Each agent observes one half of the field and sends a summary at a few inducing points. A listener fuses both summaries
and predicts everywhere.
"""

import sys

# The experiment.
import dgpc
import numpy as np

rng = np.random.default_rng(1)
prior = dgpc.Prior(dgpc.Term("squared-exponential", 0.8, variance=9.0, dimension=2))

def observe(west, east, count):
    x = rng.uniform([west, -2.0], [east, 2.0], (count, 2))
    log_odds = 5.0 * np.cos(1.7 * x[:, 0]) * np.cos(1.7 * x[:, 1])
    return x, rng.random(count) < 1.0 / (1.0 + np.exp(-log_odds))

def score(posteriors):
    p = np.mean([posterior.probability(places) for posterior in posteriors], axis=0)
    return -np.mean(np.log(np.where(outcomes, p, 1.0 - p)))

def fused(choose, fuse):
    points = [x[choose(dgpc.Candidates(prior, x)).indices] for x, _ in agents]
    pairs = [[dgpc.Summary.variational(prior, s, z) for s, z in zip(both, points)] for both in zip(*sites)]
    return score([fuse(prior, summaries=pair) for pair in pairs])

agents, (places, outcomes) = [observe(-2.0, 0.0, 150), observe(0.0, 2.0, 150)], observe(-2.0, 2.0, 2000)
omega = [dgpc.gibbs(prior, x, y, 200, seed=7)["omega"][0, ::20] for x, y in agents]
sites = [[dgpc.Sites(x, y, draw) for draw in draws] for (x, y), draws in zip(agents, omega)]
print("west alone:", round(score([dgpc.Posterior(prior, s) for s in sites[0]]), 3))
print("two summaries at eight points:", round(fused(lambda c: c.minimise_trace(8), dgpc.Posterior), 3))
# The end of the experiment.


def curves(counts: list[int]) -> dict[str, list[float]]:
    """Returns the scores for several numbers of inducing points. Random points are averaged over ten choices."""
    rules = {
        "good points": lambda count: fused(lambda c: c.minimise_trace(count), dgpc.Posterior),
        "good points, concatenated": lambda count: fused(lambda c: c.minimise_trace(count), dgpc.Concatenation),
        "random points": lambda count: np.mean(
            [fused(lambda c: c.random(count, seed=seed), dgpc.Posterior) for seed in range(10)]
        ),
    }
    return {name: [float(rule(count)) for count in counts] for name, rule in rules.items()}


def draw(path: str) -> None:
    """Draws the figure."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    counts = [2, 4, 6, 8, 12, 16, 24, 32]
    figure, axes = pyplot.subplots(figsize=(6.4, 3.8), layout="constrained")
    for (name, scores), style in zip(curves(counts).items(), ["o-", "s--", "^:"], strict=True):
        axes.plot(counts, scores, style, label=name)
    alone = np.mean([score([dgpc.Posterior(prior, s) for s in own]) for own in sites])
    whole = score([dgpc.Posterior(prior, first).absorb_events(second) for first, second in zip(*sites, strict=True)])
    for level, name, side in ((alone, "one agent alone", "bottom"), (whole, "all events", "top")):
        axes.axhline(level, color="0.4", linewidth=0.8)
        axes.text(32.5, level, name, ha="right", va=side, color="0.3")
    axes.set(xlabel="inducing points of each agent", ylabel="negative log-likelihood (nats)", ylim=(0.35, 0.75))
    axes.legend(frameon=False)
    figure.savefig(path, dpi=110, metadata={"Software": None})


if __name__ == "__main__" and len(sys.argv) > 1:
    draw(sys.argv[1])
