"""The estimator for scikit-learn."""

from __future__ import annotations

import pickle
import sys
import zlib
from collections.abc import Callable
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from sklearn.utils import check_random_state, check_scalar
from sklearn.utils.multiclass import check_classification_targets, type_of_target
from sklearn.utils.validation import check_is_fitted, validate_data

from . import _dgpc
from ._elementwise import success_probability
from ._kernels import Translation, translate

STATE_VERSION = 1

L_BFGS = "fmin_l_bfgs_b"


def print_progress(progress: dict[str, Any]) -> None:
    """Prints the progress of a fit or of learning to standard error."""
    parts = [f"{name} {value:.6g}" for name, value in progress.items() if value is not None]
    print("GaussianProcessClassifier:", ", ".join(parts), file=sys.stderr, flush=True)


class GaussianProcessClassifier(ClassifierMixin, BaseEstimator):
    """Gaussian process classification of two classes, with the interface of scikit-learn.

    Inference is mean field with Pólya-Gamma augmentation. The names are those of
    ``sklearn.gaussian_process.GaussianProcessClassifier``.

    Parameters
    ----------
    kernel : kernel of scikit-learn, optional
        Sums and products of ``ConstantKernel``, ``RBF``, ``Matern`` (nu 0.5, 1.5, 2.5 or inf) and
        ``RationalQuadratic``. The initial values are also the most probable values before the data are seen. ``None``
        is ``ConstantKernel(1.0) * RBF(s)``. Here s is the root mean square distance of the inputs from their mean.
    optimizer : "fmin_l_bfgs_b", callable or None, default "fmin_l_bfgs_b"
        The default is the search of ``dgpc.learn``, with calibrated variances. A callable has scikit-learn's
        signature ``optimizer(objective, initial_theta, bounds)``. ``None`` keeps the initial values.
    n_restarts_optimizer : int, default 0
        Number of further starts, drawn uniformly between the bounds of the logarithms.
    max_iter_predict : int, default 1000
        Largest number of iterations of a fit. The default optimizer has its own limit.
    warm_start : bool, default False
        Whether a new fit starts from the hyperparameters of the last fit.
    random_state : int, RandomState instance or None, default None
        Generator of the further starts.
    inducing_points : int, array of shape (M, d) or None, default None
        Points that support the posterior in place of the events. A number is chosen among the inputs.
    verbose : bool, default False
        Whether work of more than two seconds prints its progress to standard error, about twice a second.

    Attributes
    ----------
    kernel_ : kernel of scikit-learn
        The learned kernel, as a sum of terms. Each term is a constant times one or more correlations.
    classes_ : array of shape (2,)
    prior_ : dgpc.Prior
        The prior with the learned kernel.
    X_train_, y_train_ : arrays
        The events; `y_train_` is true for the second class.
    omega_ : array
        Expected Pólya-Gamma variables of the events.
    inducing_points_ : array or None
        Inducing points of a sparse fit.
    log_marginal_likelihood_value_ : float
        The evidence bound in nats.
    n_features_in_ : int

    Examples
    --------
    >>> import dgpc, numpy as np
    >>> X = np.linspace(-3, 3, 60)[:, None]
    >>> model = dgpc.GaussianProcessClassifier().fit(X, abs(X[:, 0]) < 2)
    >>> model.predict([[0.0], [2.9]])
    array([ True, False])
    """

    def __init__(
        self,
        kernel: Any = None,
        *,
        optimizer: Any = L_BFGS,
        n_restarts_optimizer: int = 0,
        max_iter_predict: int = 1000,
        warm_start: bool = False,
        random_state: Any = None,
        inducing_points: Any = None,
        verbose: bool = False,
    ) -> None:
        self.kernel = kernel
        self.optimizer = optimizer
        self.n_restarts_optimizer = n_restarts_optimizer
        self.max_iter_predict = max_iter_predict
        self.warm_start = warm_start
        self.random_state = random_state
        self.inducing_points = inducing_points
        self.verbose = verbose

    def fit(self, X: ArrayLike, y: ArrayLike) -> GaussianProcessClassifier:
        """Learns the hyperparameters and fits the events. After an exception, the results of an earlier fit remain.

        There is no ``sample_weight``, because learning does not treat a weight of two as two rows. ``dgpc.fit`` has
        weights.

        Parameters
        ----------
        X : array of shape (N, d)
        y : array of shape (N,)
            Labels of two classes.

        Returns
        -------
        self

        Examples
        --------
        >>> import dgpc
        >>> model = dgpc.GaussianProcessClassifier().fit([[0.0], [1.0], [2.0], [3.0]], ["no", "no", "yes", "yes"])
        >>> model.classes_.tolist(), model.n_features_in_
        (['no', 'yes'], 1)
        """
        check_scalar(self.max_iter_predict, "max_iter_predict", Integral, min_val=1)
        check_scalar(self.n_restarts_optimizer, "n_restarts_optimizer", Integral, min_val=0)
        # Validation stores the number of columns and their names. They belong to this estimator once the fit succeeds.
        inputs, labels = validate_data(type(self)(), X, y)
        check_classification_targets(labels)
        kind = type_of_target(labels, input_name="y")
        classes, outcomes = np.unique(labels, return_inverse=True)
        if kind != "binary" or classes.size > 2:
            raise ValueError(
                f"Only binary classification is supported. The type of the target is {kind}. "
                "OneVsRestClassifier combines several binary classifiers."
            )
        if classes.size < 2:
            raise ValueError(f"y must contain two classes, found one class: {classes}")
        last = getattr(self, "kernel_", None) if self.warm_start else None
        translation = self._translation(inputs, last)
        fit = self._learned(translation, inputs, outcomes)
        validate_data(self, X, y, skip_check_array=True)
        self.classes_ = classes
        self._store(translation, fit)
        return self

    def partial_fit(self, X: ArrayLike, y: ArrayLike, classes: ArrayLike | None = None) -> GaussianProcessClassifier:
        """Adds events and keeps the hyperparameters. An estimator that was not fitted keeps the initial values.

        Parameters
        ----------
        X : array of shape (N, d)
        y : array of shape (N,)
        classes : array of shape (2,), optional
            The labels of both classes. Needed in the first call if the estimator was not fitted.

        Returns
        -------
        self

        Examples
        --------
        >>> import dgpc
        >>> model = dgpc.GaussianProcessClassifier().fit([[0.0], [1.0], [2.0], [3.0]], ["no", "no", "yes", "yes"])
        >>> len(model.partial_fit([[4.0]], ["yes"]).y_train_)
        5
        """
        is_first = not hasattr(self, "classes_")
        inputs, labels = validate_data(self, X, y, reset=is_first)
        known: Any = np.unique(np.asarray(classes)) if classes is not None else getattr(self, "classes_", None)
        if not is_first:
            if not np.array_equal(known, self.classes_):
                raise ValueError(f"classes differ from those before: expected {self.classes_}, found {known}")
            known = self.classes_
        if known is None or known.size != 2:
            raise ValueError("the first call of partial_fit needs classes, an array of two labels")
        if not np.isin(labels, known).all():
            raise ValueError(f"y contains labels other than the classes {known}")
        outcomes = labels == known[1]
        if is_first:
            translation = self._translation(inputs, None)
        else:
            translation = translate(self.kernel_, inputs.shape[1])
            inputs = np.concatenate([self.X_train_, inputs])
            outcomes = np.concatenate([self.y_train_, outcomes])
        fit = self._fitted(translation.prior, inputs, outcomes)
        self.classes_ = known
        self._store(translation, fit)
        return self

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """Returns the more probable class of every row, shape (N,).

        Examples
        --------
        >>> import dgpc
        >>> model = dgpc.GaussianProcessClassifier().fit([[0.0], [1.0], [2.0], [3.0]], ["no", "no", "yes", "yes"])
        >>> model.predict([[0.0], [4.0]]).tolist()
        ['no', 'yes']
        """
        is_second = self.decision_function(X) > 0
        return np.asarray(self.classes_[is_second.astype(int)])

    def predict_proba(self, X: ArrayLike) -> NDArray[np.float64]:
        """Returns the probabilities of both classes for every row, shape (N, 2).

        Examples
        --------
        >>> import dgpc
        >>> model = dgpc.GaussianProcessClassifier().fit([[0.0], [1.0], [2.0], [3.0]], ["no", "no", "yes", "yes"])
        >>> model.predict_proba([[1.5]]).round(2)
        array([[0.5, 0.5]])
        """
        mean, variance = self.latent_mean_and_variance(X)
        # The small one of the two probabilities keeps its digits.
        return np.column_stack([success_probability(-mean, variance), success_probability(mean, variance)])

    def decision_function(self, X: ArrayLike) -> NDArray[np.float64]:
        """Returns the log-odds of the second class for every row, shape (N,): those of `predict_proba`.

        Examples
        --------
        >>> import dgpc
        >>> model = dgpc.GaussianProcessClassifier().fit([[0.0], [1.0], [2.0], [3.0]], ["no", "no", "yes", "yes"])
        >>> model.decision_function([[0.0], [3.0]]) > 0
        array([False,  True])
        """
        first, second = self.predict_proba(X).T
        return np.asarray(np.log(second) - np.log(first))

    def latent_mean_and_variance(self, X: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns the mean and the variance of the latent function at every row.

        Returns
        -------
        mean, variance : arrays of shape (N,)

        Examples
        --------
        >>> import dgpc
        >>> model = dgpc.GaussianProcessClassifier().fit([[0.0], [1.0], [2.0], [3.0]], ["no", "no", "yes", "yes"])
        >>> mean, variance = model.latent_mean_and_variance([[3.0]])
        >>> mean > 0
        array([ True])
        """
        check_is_fitted(self)
        return self._posterior.latent(validate_data(self, X, reset=False))

    def log_marginal_likelihood(
        self, theta: ArrayLike | None = None, eval_gradient: bool = False, clone_kernel: bool = True
    ) -> Any:
        """Returns the evidence bound, a lower bound on the log marginal likelihood, in nats.

        Parameters
        ----------
        theta : array, optional
            Logarithms of the free hyperparameters of `kernel_`. ``None`` returns the value of the fit.
        eval_gradient : bool, default False
            Whether the gradient by `theta` is returned, too.
        clone_kernel : bool, default True
            Has no effect: `kernel_` never changes. scikit-learn's class has this parameter.

        Returns
        -------
        float, or float and array

        Examples
        --------
        >>> import dgpc
        >>> model = dgpc.GaussianProcessClassifier().fit([[0.0], [1.0], [2.0], [3.0]], ["no", "no", "yes", "yes"])
        >>> value, gradient = model.log_marginal_likelihood(model.kernel_.theta, eval_gradient=True)
        >>> value < 0, gradient.shape
        (True, (2,))
        """
        check_is_fitted(self)
        if theta is None:
            if eval_gradient:
                raise ValueError("the gradient can be evaluated only for a given theta")
            return self.log_marginal_likelihood_value_
        translation = translate(self.kernel_, self.n_features_in_)
        events, points = (self.X_train_, self.y_train_), self.inducing_points_
        value, gradient = self._evidence(translation, np.asarray(theta), *events, points)
        return (value, gradient) if eval_gradient else value

    def _translation(self, X: NDArray[Any], last: Any) -> Translation:
        """Returns the kernel from which learning starts."""
        kernel = self.kernel if last is None else last
        if kernel is None:
            spread = float(np.sqrt(np.var(X, axis=0, dtype=float).sum()))
            kernel = ConstantKernel(1.0) * RBF(spread if np.isfinite(spread) and spread > 0 else 1.0)
        return translate(kernel, X.shape[1])

    def _points(self, X: NDArray[Any]) -> Any:
        """Returns the parameter `inducing_points`, checked."""
        points = self.inducing_points
        if points is None or np.ndim(points) == 0:
            return points
        if np.ndim(points) != 2 or np.shape(points)[1] != X.shape[1]:
            raise ValueError(f"inducing_points must have shape (M, {X.shape[1]}), found {np.shape(points)}")
        return points

    def _progress(self) -> Callable[[dict[str, Any]], None] | None:
        return print_progress if self.verbose else None

    def _fitted(self, prior: _dgpc.Prior, X: NDArray[Any], outcomes: NDArray[Any]) -> _dgpc.Fit:
        """Fits the events under a prior."""
        return _dgpc.fit(
            prior,
            X,
            outcomes,
            inducing_points=self._points(X),
            iterations_max=self.max_iter_predict,
            progress=self._progress(),
        )

    def _learned(self, translation: Translation, X: NDArray[Any], outcomes: NDArray[Any]) -> _dgpc.Fit:
        """Learns the free hyperparameters, and fits the events under the learned prior."""
        if self.optimizer is None or not translation.is_free.any():
            return self._fitted(translation.prior, X, outcomes)
        bounds = translation.kernel.bounds
        generator = check_random_state(self.random_state)
        starts = [np.clip(translation.kernel.theta, bounds[:, 0], bounds[:, 1])]
        if self.n_restarts_optimizer > 0:
            if not np.isfinite(bounds).all():
                raise ValueError("n_restarts_optimizer above 0 needs finite bounds of all free hyperparameters")
            starts += [generator.uniform(bounds[:, 0], bounds[:, 1]) for _ in range(self.n_restarts_optimizer)]
        if callable(self.optimizer):
            return self._optimized(translation, starts, X, outcomes)
        if self.optimizer != L_BFGS:
            raise ValueError(f"optimizer must be {L_BFGS!r}, a callable or None, found {self.optimizer!r}")
        points = self._points(X)
        is_number = points is not None and np.ndim(points) == 0
        sparse: dict[str, Any] = {"inducing_points": None if is_number else points}
        if is_number:
            sparse |= {"dense_events_max": points, "inducing_points_max": points}
        learned = _dgpc.learn(
            translation.prior_at(starts[0]),
            X,
            outcomes,
            bounds=translation.bounds(),
            further_starts=[translation.prior_at(start) for start in starts[1:]],
            progress=self._progress(),
            **sparse,
        )
        return self._fitted(learned.prior, X, outcomes) if is_number else learned.fit

    def _optimized(
        self, translation: Translation, starts: list[NDArray[np.float64]], X: NDArray[Any], outcomes: NDArray[Any]
    ) -> _dgpc.Fit:
        """Runs the optimiser of the caller from every start, and fits the events under the best prior."""

        def objective(theta: NDArray[np.float64], eval_gradient: bool = True) -> Any:
            value, gradient = self._evidence(translation, theta, X, outcomes, self._points(X))
            return (-value, -gradient) if eval_gradient else -value

        ends = [self.optimizer(objective, start, bounds=translation.kernel.bounds) for start in starts]
        theta, _ = min(ends, key=lambda end: float(end[1]))
        return self._fitted(translation.prior_at(theta), X, outcomes)

    def _evidence(
        self, translation: Translation, theta: NDArray[Any], X: NDArray[Any], outcomes: NDArray[Any], points: Any
    ) -> tuple[float, NDArray[np.float64]]:
        """Returns the evidence bound on inducing points and its gradient at free hyperparameters."""
        fit, gradient = _dgpc.evidence(
            translation.prior_at(theta),
            X,
            outcomes,
            inducing_points=points,
            iterations_max=self.max_iter_predict,
            progress=self._progress(),
        )
        return fit.evidence, translation.theta_of(gradient)

    def _store(self, translation: Translation, fit: _dgpc.Fit) -> None:
        """Stores the results of a fit."""
        theta = translation.theta_of(fit.prior.parameter_values)
        self.kernel_ = translation.kernel.clone_with_theta(theta)
        self.prior_ = fit.prior
        self.X_train_, self.y_train_, self.omega_ = fit.sites.x, fit.sites.kappa > 0, fit.omega
        self.inducing_points_ = fit.inducing_points
        self.log_marginal_likelihood_value_ = fit.evidence
        self.n_iter_ = fit.iterations
        self._posterior = self._posterior_of_events()

    def _posterior_of_events(self) -> _dgpc.Posterior:
        """Returns the posterior of the stored events and ω."""
        sites = _dgpc.Sites(self.X_train_, self.y_train_, self.omega_)
        if self.inducing_points_ is None:
            return _dgpc.Posterior(self.prior_, sites)
        summary = _dgpc.Summary.variational(self.prior_, sites, self.inducing_points_)
        return _dgpc.Posterior(self.prior_, summaries=[summary])

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.classifier_tags.multi_class = False
        return tags

    def __getstate__(self) -> dict[str, Any]:
        state = {name: value for name, value in super().__getstate__().items() if name != "_posterior"}
        # Some callables, such as functions of a notebook, can be pickled by the caller's pickler only.
        optimizer = state.pop("optimizer", None)
        data = pickle.dumps(state)
        return {"_state": data, "_checksum": zlib.crc32(data), "optimizer": optimizer, "_state_version": STATE_VERSION}

    def __setstate__(self, state: dict[str, Any]) -> None:
        version, data = state.get("_state_version"), state.get("_state")
        if not isinstance(version, int) or version > STATE_VERSION:
            raise ValueError(f"this pickle has version {version}; this package reads versions up to {STATE_VERSION}")
        if not isinstance(data, bytes) or zlib.crc32(data) != state.get("_checksum"):
            raise ValueError("this pickle is damaged: the checksum differs")
        super().__setstate__({"verbose": False} | pickle.loads(data) | {"optimizer": state.get("optimizer")})
        if hasattr(self, "prior_"):
            self._posterior = self._posterior_of_events()
