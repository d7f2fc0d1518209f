"""Runs one work with the software that people use otherwise: a line in, a line out, as `src/main.rs` does. `peers.py WORK
FOLDER`, where FOLDER holds the data that `pingmap-bench --data` writes."""

import sys
import time
import warnings
from pathlib import Path

import numpy as np

warnings.filterwarnings("ignore")
LENGTH_SCALES, VARIANCE, DRAWS = np.array([0.5, 0.7, 1.0, 1.5]), 4.0, 200_000


def events(count):
    table = np.loadtxt(Path(sys.argv[2]) / f"{count}.csv", delimiter=",")
    return table[:, :4].copy(), table[:, 4].astype(int)


def gram(a, b=None):
    a, b = a / LENGTH_SCALES, (a if b is None else b) / LENGTH_SCALES
    squared = (a * a).sum(1)[:, None] + (b * b).sum(1) - 2 * a @ b.T
    return VARIANCE * np.exp(-0.5 * np.maximum(squared, 0))


def loss(probabilities, outcomes):
    p = np.clip(np.ravel(probabilities), 1e-12, 1 - 1e-12)
    return float(-np.where(outcomes > 0, np.log(p), np.log(1 - p)).mean())


def draws(tilt):
    """Both of the package's exact samplers, the faster of the two at this tilt."""
    from polyagamma import random_polyagamma

    rng = np.random.default_rng(1)
    tilts = rng.normal(0, 2, DRAWS) if tilt is None else np.full(DRAWS, tilt)

    def by(method):
        begin = time.process_time()
        drawn = random_polyagamma(1, tilts, method=method, random_state=rng)
        return time.process_time() - begin, drawn

    fastest = min(("devroye", "alternate"), key=lambda method: min(by(method)[0] for _ in range(5)))
    return DRAWS, lambda: by(fastest)[1].mean()


def sweep(count):
    """One Cholesky a sweep, and a pathwise draw: the strongest form in numpy."""
    from polyagamma import random_polyagamma
    from scipy.linalg import cho_factor, cho_solve, cholesky

    places, outcomes = events(count)
    covariance = gram(places) + 1e-6 * np.eye(count)
    root, kappa, rng = cholesky(covariance, lower=True), outcomes - 0.5, np.random.default_rng(0)
    omega = np.full(count, 0.25)

    def once():
        nonlocal omega
        roots = np.sqrt(omega)
        b = roots[:, None] * covariance * roots
        b.flat[:: count + 1] += 1
        factor = cho_factor(b, lower=True, overwrite_a=True, check_finite=False)
        prior = root @ rng.standard_normal(count)
        residual = kappa / roots - roots * prior - rng.standard_normal(count)
        latent = prior + covariance @ (roots * cho_solve(factor, residual, check_finite=False))
        omega = random_polyagamma(1, latent, method="devroye", random_state=rng)
        return float("nan")

    return 1, once


def best_pair(count):
    places, _ = events(count)

    def once():
        k = gram(places)
        squared = k @ k
        explained = np.diag(squared)
        numerator = (explained[:, None] + explained[None, :]) * VARIANCE - 2 * k * squared
        determinant = VARIANCE**2 - k * k
        np.fill_diagonal(determinant, np.inf)
        return VARIANCE * count - (numerator / np.maximum(determinant, 1e-9)).max()

    return 1, once


def greedy(count, points=50):
    """Greedy for the trace, by rank-one updates of the residual covariance."""
    places, _ = events(count)
    covariance = gram(places)

    def once():
        left = covariance.copy()
        for _ in range(points):
            variance = np.diag(left)
            explained = np.where(variance > 1e-4 * VARIANCE, (left * left).sum(0) / np.maximum(variance, 1e-12), 0)
            column = left[:, explained.argmax()].copy()
            left -= np.outer(column, column / column[explained.argmax()])
        return float(np.trace(left))

    return 1, once


def greedy_by_variance(count, points=50):
    """Greedy for the largest conditional variance: what software offers for many candidates."""
    places, _ = events(count)

    def once():
        left, factor = np.full(count, VARIANCE), np.zeros((points, count))
        for n in range(points):
            place = left.argmax()
            column = gram(places[place : place + 1], places)[0] - factor[:n, place] @ factor[:n]
            factor[n] = column / np.sqrt(left[place])
            left = np.maximum(left - factor[n] ** 2, 0)
        return float(left.sum())

    return 1, once


def laplace(optimiser=None):
    from sklearn.gaussian_process import GaussianProcessClassifier
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    kernel = ConstantKernel(1.0) * RBF(np.ones(4)) if optimiser else ConstantKernel(VARIANCE) * RBF(LENGTH_SCALES)
    return GaussianProcessClassifier(kernel, optimizer=optimiser)


def fit(count):
    places, outcomes = events(count)
    return 1, lambda: float(laplace().fit(places, outcomes).log_marginal_likelihood_value_)


def learn(count):
    (places, outcomes), (test, happened) = events(count), events(5000)
    return 1, lambda: loss(laplace("fmin_l_bfgs_b").fit(places, outcomes).predict_proba(test)[:, 1], happened)


def predict(count):
    fitted, (test, happened) = laplace().fit(*events(count)), events(10_000)
    return 1, lambda: loss(fitted.predict_proba(test)[:, 1], happened)


def learn_sparse(count, points):
    """GPyTorch with its Pólya-Gamma example: natural gradients and Adam, ten epochs of batches of a thousand."""
    import gpytorch
    import torch

    torch.set_num_threads(1)
    torch.set_default_dtype(torch.float64)

    class Likelihood(gpytorch.likelihoods._OneDimensionalLikelihood):
        def expected_log_prob(self, target, inputs, *_, **__):
            mean, variance = inputs.mean, inputs.variance
            second = variance + mean.pow(2)
            tilt = second.detach().sqrt()
            return (0.5 * (2 * target - 1) * mean - 0.25 * torch.tanh(0.5 * tilt) / tilt * second).sum(-1)

        def forward(self, latent):
            return torch.distributions.Bernoulli(logits=latent)

        def marginal(self, latent):
            return torch.distributions.Bernoulli(probs=self.quadrature(lambda f: self.forward(f).probs, latent))

    class Model(gpytorch.models.ApproximateGP):
        def __init__(self, inducing):
            natural = gpytorch.variational.NaturalVariationalDistribution(len(inducing))
            strategy = gpytorch.variational.VariationalStrategy(self, inducing, natural, learn_inducing_locations=True)
            super().__init__(strategy)
            self.mean_module = gpytorch.means.ZeroMean()
            self.covar_module = gpytorch.kernels.ScaleKernel(gpytorch.kernels.RBFKernel(ard_num_dims=4))
            self.covar_module.outputscale = 1.0
            self.covar_module.base_kernel.lengthscale = torch.ones(4)

        def forward(self, x):
            return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))

    places, outcomes = (torch.tensor(a, dtype=torch.float64) for a in events(count))
    test, happened = events(5000)

    def once():
        order = torch.Generator().manual_seed(0)
        model, likelihood = Model(places[torch.randperm(count, generator=order)[:points]].clone()), Likelihood()
        bound = gpytorch.mlls.VariationalELBO(likelihood, model, num_data=count)
        steps = (
            gpytorch.optim.NGD(model.variational_parameters(), num_data=count, lr=0.1),
            torch.optim.Adam(model.hyperparameters(), lr=0.01),
        )
        for _ in range(10):
            for batch in torch.randperm(count, generator=order).split(1000):
                [step.zero_grad() for step in steps]
                (-bound(model(places[batch]), outcomes[batch])).backward()
                [step.step() for step in steps]
        model.eval()
        with torch.no_grad():
            return loss(likelihood(model(torch.tensor(test))).probs.numpy(), happened)

    return 1, once


def learn_sparse_gpflow(count, points):
    """GPflow's SVGP as its documentation shows it for large data: natural gradients and Adam, ten epochs of batches of a
    thousand."""
    import gpflow
    import tensorflow as tf

    tf.config.threading.set_intra_op_parallelism_threads(1)
    tf.config.threading.set_inter_op_parallelism_threads(1)
    (places, outcomes), (test, happened) = events(count), events(5000)
    outcomes = outcomes[:, None].astype(float)

    def once():
        rng = np.random.default_rng(0)
        inducing = places[rng.permutation(count)[:points]].copy()
        kernel = gpflow.kernels.SquaredExponential(variance=1.0, lengthscales=np.ones(4))
        likelihood = gpflow.likelihoods.Bernoulli(invlink=tf.sigmoid)
        model = gpflow.models.SVGP(kernel, likelihood, inducing, num_data=count, whiten=True)
        data = tf.data.Dataset.from_tensor_slices((places, outcomes)).shuffle(count, seed=0).batch(1000).repeat()
        gpflow.set_trainable(model.q_mu, False)
        gpflow.set_trainable(model.q_sqrt, False)
        closure, variables = model.training_loss_closure(iter(data), compile=False), model.trainable_variables
        natural, adam = gpflow.optimizers.NaturalGradient(gamma=0.1), tf.keras.optimizers.Adam(0.01)
        adam.build(variables)

        @tf.function
        def step():
            natural.minimize(closure, [(model.q_mu, model.q_sqrt)])
            with tf.GradientTape() as tape:
                value = closure()
            adam.apply_gradients(zip(tape.gradient(value, variables), variables))

        for _ in range(10 * count // 1000):
            step()
        return loss(model.predict_y(test)[0].numpy(), happened)

    return 1, once


WORKS = {
    **{f"draw {tilt:g}": (lambda tilt=tilt: draws(tilt)) for tilt in (0.0, 0.5, 2.0, 5.0, 20.0)},
    "draw mixed": lambda: draws(None),
    **{f"sweep {count}": (lambda count=count: sweep(count)) for count in (200, 446, 1000, 2000)},
    "best pair 446": lambda: best_pair(446),
    "greedy 50 of 446": lambda: greedy(446),
    "greedy 50 of 10000": lambda: greedy_by_variance(10_000),
    "fit 446": lambda: fit(446),
    "fit 1000": lambda: fit(1000),
    "learn 1000": lambda: learn(1000),
    "learn 100000 on 100": lambda: learn_sparse(100_000, 100),
    "learn 100000 on 100, GPflow": lambda: learn_sparse_gpflow(100_000, 100),
    "predict 10000 from 446": lambda: predict(446),
    "predict 10000 from 1000": lambda: predict(1000),
}


def main():
    repeats, once = WORKS[sys.argv[1]]()
    once()
    print("ready", flush=True)
    for _ in sys.stdin:
        begin = time.process_time()
        how_well = once()
        print((time.process_time() - begin) / repeats, how_well, flush=True)


if __name__ == "__main__":
    main()
