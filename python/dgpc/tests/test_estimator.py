"""The estimator keeps the conventions of scikit-learn."""

import copy
import pickle

import dgpc
import numpy as np
import pytest

sklearn = pytest.importorskip("sklearn", reason="scikit-learn is not installed: no tests of the estimator")

from scipy.optimize import minimize
from sklearn.base import clone
from sklearn.datasets import make_blobs
from sklearn.exceptions import NotFittedError
from sklearn.gaussian_process import GaussianProcessClassifier as Laplace
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, DotProduct, ExpSineSquared, Matern, RationalQuadratic
from sklearn.gaussian_process.kernels import WhiteKernel
from sklearn.model_selection import GridSearchCV, cross_val_score
from sklearn.multiclass import OneVsRestClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import parametrize_with_checks

Classifier = dgpc.GaussianProcessClassifier

KERNELS = {
    "default": None,
    "RBF": ConstantKernel(2.0) * RBF(0.8),
    "RBF without constant": RBF(0.8),
    "Matern 1/2": ConstantKernel(2.0) * Matern(0.8, nu=0.5),
    "Matern 3/2": ConstantKernel(2.0) * Matern(0.8, nu=1.5),
    "Matern 5/2": ConstantKernel(2.0) * Matern(0.8, nu=2.5),
    "Matern inf": ConstantKernel(2.0) * Matern(0.8, nu=np.inf),
    "rational quadratic": ConstantKernel(2.0) * RationalQuadratic(0.8, alpha=1.5),
    "sum": ConstantKernel(2.0) * RBF(0.8) + ConstantKernel(0.5) * Matern(2.0, nu=1.5),
    "product": ConstantKernel(2.0) * RBF(0.8) * RationalQuadratic(3.0),
    "product of a sum": ConstantKernel(2.0) * (RBF(0.8) + Matern(2.0, nu=0.5)),
}

ARD = {
    "RBF": ConstantKernel(2.0) * RBF([0.8, 2.0]),
    "Matern": Matern([0.8, 2.0], nu=1.5) * ConstantKernel(2.0),
    "product": ConstantKernel(2.0) * RBF([0.8, 2.0]) * Matern([1.0, 3.0], nu=2.5) + RationalQuadratic(),
}


@pytest.fixture
def data() -> tuple[np.ndarray, np.ndarray]:
    x = np.random.default_rng(2).normal(size=(80, 2))
    return x, np.where(x[:, 0] * x[:, 1] + 0.3 * np.random.default_rng(3).normal(size=80) > 0, "yes", "no")


ESTIMATORS = [Classifier(kernel) for kernel in KERNELS.values()]
ESTIMATORS += [Classifier(inducing_points=8), Classifier(optimizer=None)]


@parametrize_with_checks(ESTIMATORS, expected_failed_checks=lambda estimator: {})
def test_scikit_learn_checks(estimator, check) -> None:
    check(estimator)


@pytest.mark.parametrize("kernel", [*KERNELS.values(), *ARD.values()], ids=[*KERNELS, *(f"ARD {name}" for name in ARD)])
def test_a_translated_kernel_has_the_values_and_the_gradient_of_the_original(kernel, data) -> None:
    x, y = data
    model = Classifier(kernel, optimizer=None).fit(x, y)
    original = model.kernel_ if kernel is None else kernel
    np.testing.assert_allclose(model.prior_.kernel.gram(x), original(x), atol=1e-12)
    np.testing.assert_allclose(model.kernel_(x), original(x), atol=1e-12)
    theta = model.kernel_.theta
    assert model.log_marginal_likelihood(theta) == pytest.approx(model.log_marginal_likelihood(), abs=1e-8)
    _, gradient = model.log_marginal_likelihood(theta, eval_gradient=True)
    for place, step in enumerate(1e-5 * np.eye(len(theta))):
        slope = (model.log_marginal_likelihood(theta + step) - model.log_marginal_likelihood(theta - step)) / 2e-5
        assert gradient[place] == pytest.approx(slope, abs=1e-4)


@pytest.mark.parametrize(
    "kernel", [DotProduct(), RBF() + WhiteKernel(), ExpSineSquared(), Matern(nu=3.5), ConstantKernel(), "RBF"]
)
def test_other_kernels_are_refused_with_a_list_of_supported_ones(kernel, data) -> None:
    with pytest.raises(ValueError, match="supported are ConstantKernel, RBF, Matern .* RationalQuadratic"):
        Classifier(kernel).fit(*data)


def test_length_scales_must_match_the_columns(data) -> None:
    with pytest.raises(ValueError, match="3 length-scales, but the inputs have 2 columns"):
        Classifier(RBF([1.0, 1.0, 1.0])).fit(*data)


def test_learning_improves_the_evidence_and_keeps_fixed_parameters(data) -> None:
    kernel = ConstantKernel(2.0, "fixed") * RBF([0.1, 5.0])
    model = Classifier(kernel).fit(*data)
    assert model.kernel_.k1.constant_value == 2.0
    assert model.log_marginal_likelihood() > Classifier(kernel, optimizer=None).fit(*data).log_marginal_likelihood()
    fixed = Classifier(ConstantKernel(2.0, "fixed") * RBF(0.7, "fixed")).fit(*data)
    assert fixed.kernel_.k2.length_scale == 0.7
    mixed = Classifier(ConstantKernel(2.0) * RBF() + RBF()).fit(*data)
    assert mixed.kernel_.k2.k1.constant_value == 1.0 and mixed.kernel_.k1.k1.constant_value != 2.0


def test_probabilities_are_near_those_of_scikit_learn(data) -> None:
    x, y = data
    kernel = ConstantKernel(2.0, "fixed") * RBF(1.0, "fixed")
    expected = Laplace(kernel).fit(x, y).predict_proba(x)
    found = Classifier(kernel).fit(x, y).predict_proba(x)
    assert np.abs(found - expected).max() < 0.05


def test_the_decision_function_is_the_log_odds_of_the_probability(data) -> None:
    x, y = data
    model = Classifier().fit(x, y)
    probability = model.predict_proba(x)
    np.testing.assert_allclose(probability.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(model.decision_function(x), np.log(probability[:, 1] / probability[:, 0]), atol=1e-9)
    np.testing.assert_array_equal(model.predict(x), model.classes_[(probability[:, 1] > 0.5).astype(int)])
    mean, variance = model.latent_mean_and_variance(x)
    np.testing.assert_allclose(dgpc.success_probability(mean, variance), probability[:, 1])


def test_sparse_forms_are_near_the_dense_form(data) -> None:
    x, y = data
    dense = Classifier(ConstantKernel(2.0) * RBF(1.0), optimizer=None).fit(x, y)
    for points in [60, x[:60]]:
        sparse = clone(dense).set_params(inducing_points=points).fit(x, y)
        # A greedy choice ends when the remaining inputs are explained.
        assert 30 < len(sparse.inducing_points_) <= 60
        assert np.abs(sparse.predict_proba(x) - dense.predict_proba(x)).max() < 0.02
    learned = Classifier(inducing_points=20).fit(x, y)
    assert len(learned.inducing_points_) <= 20 and learned.score(x, y) > 0.8
    assert len(Classifier(inducing_points=500).fit(x, y).omega_) == 80
    # The search uses given points, too: no other kernel is better for these points.
    given = Classifier(inducing_points=x[::16]).fit(x, y)
    np.testing.assert_array_equal(given.inducing_points_, x[::16])
    other = Classifier(Classifier().fit(x, y).kernel_, optimizer=None, inducing_points=x[::16]).fit(x, y)
    assert given.log_marginal_likelihood_value_ > other.log_marginal_likelihood_value_
    for bad in [0, -1, "three", x[:, :1], [1.0, 2.0], [[np.nan, 0.0]]]:
        with pytest.raises((ValueError, TypeError)):
            Classifier(inducing_points=bad).fit(x, y)


def test_weights_are_not_accepted(data) -> None:
    with pytest.raises(TypeError, match="sample_weight"):
        Classifier().fit(*data, sample_weight=np.ones(80))


def test_one_and_three_classes_are_refused(data) -> None:
    x = data[0]
    with pytest.raises(ValueError, match="one class"):
        Classifier().fit(x, np.zeros(80))
    with pytest.raises(ValueError, match="Only binary classification is supported"):
        Classifier().fit(x, np.arange(80) % 3)
    with pytest.raises(NotFittedError):
        Classifier().predict(x)


def test_an_optimizer_of_the_caller_maximises_the_evidence(data) -> None:
    def optimizer(objective, initial_theta, bounds):
        result = minimize(objective, initial_theta, jac=True, bounds=bounds, method="L-BFGS-B")
        return result.x, result.fun

    model = Classifier(ConstantKernel(2.0) * RBF(0.3), optimizer=optimizer, n_restarts_optimizer=1, random_state=1)
    _, gradient = model.fit(*data).log_marginal_likelihood(model.kernel_.theta, eval_gradient=True)
    assert np.abs(gradient).max() < 0.05
    for bad in ["lbfgs", 1]:
        with pytest.raises(ValueError, match="optimizer must be"):
            Classifier(optimizer=bad).fit(*data)


def test_restarts_are_reproducible(data) -> None:
    models = [Classifier(n_restarts_optimizer=2, random_state=5).fit(*data) for _ in range(2)]
    np.testing.assert_array_equal(models[0].kernel_.theta, models[1].kernel_.theta)


@pytest.mark.parametrize("points", [None, 10])
def test_partial_fit_adds_events_and_keeps_hyperparameters(points, data) -> None:
    x, y = data
    model = Classifier(inducing_points=points).fit(x[:40], y[:40])
    theta = model.kernel_.theta
    model.partial_fit(x[40:], y[40:])
    np.testing.assert_array_equal(model.kernel_.theta, theta)
    whole = Classifier(model.kernel_, optimizer=None, inducing_points=points).fit(x, y)
    np.testing.assert_allclose(model.predict_proba(x), whole.predict_proba(x), atol=1e-9)


def test_partial_fit_needs_the_classes_first(data) -> None:
    x, y = data
    with pytest.raises(ValueError, match="needs classes"):
        Classifier().partial_fit(x, y)
    model = Classifier(RBF()).partial_fit(x[:1], y[:1], classes=["no", "yes"])
    assert model.partial_fit(x[1:], y[1:]).omega_.shape == (80,)
    with pytest.raises(ValueError, match="labels other than the classes"):
        model.partial_fit(x[:1], ["perhaps"])


@pytest.mark.parametrize("points", [None, 10])
def test_a_pickle_keeps_the_predictions_and_holds_no_matrix(points, data) -> None:
    x, y = data
    model = Classifier(inducing_points=points).fit(x, y)
    pickled = pickle.dumps(model)
    for again in (pickle.loads(pickled), copy.deepcopy(model)):
        np.testing.assert_array_equal(again.predict_proba(x), model.predict_proba(x))
        again.partial_fit(x[:3], y[:3])
    assert len(pickled) < 80 * 5 * 8 + 4000
    assert pickle.loads(pickle.dumps(Classifier())).get_params() == Classifier().get_params()


def test_damaged_and_newer_pickles_are_refused(data) -> None:
    state = Classifier().fit(*data).__getstate__()
    for name, value in [("_state", state["_state"][:-1]), ("_state", None), ("_checksum", 0), ("_checksum", None)]:
        with pytest.raises(ValueError, match="damaged"):
            Classifier().__setstate__({**state, name: value})
        with pytest.raises(ValueError, match="damaged"):
            Classifier().__setstate__({key: item for key, item in state.items() if key != name})
    for version in [None, 2, "one"]:
        with pytest.raises(ValueError, match="reads versions up to 1"):
            Classifier().__setstate__({**state, "_state_version": version})


def test_changed_numbers_in_a_pickle_are_refused(data) -> None:
    model = Classifier().fit(*data)
    pickled = pickle.dumps(model)
    for numbers in (model.X_train_, model.omega_, model.y_train_):
        content = numbers.tobytes()
        first = pickled.index(content)
        for place in range(first, first + len(content), 37):
            damaged = pickled[:place] + bytes([pickled[place] ^ 1]) + pickled[place + 1 :]
            with pytest.raises(ValueError, match="damaged"):
                pickle.loads(damaged)


def test_it_works_in_a_pipeline_and_a_grid_search(data) -> None:
    x, y = data
    pipeline = make_pipeline(StandardScaler(), Classifier())
    grid = {"gaussianprocessclassifier__kernel": [RBF(), ConstantKernel(2.0) * Matern(nu=1.5)]}
    search = GridSearchCV(pipeline, grid, cv=3, scoring="neg_log_loss", n_jobs=2).fit(x * 100.0, y)
    assert search.best_score_ > -0.6


def test_it_works_in_cross_validation(data) -> None:
    assert cross_val_score(Classifier(), *data, cv=3).mean() > 0.75


def test_only_a_verbose_estimator_prints_its_progress(data, monkeypatch, capfd) -> None:
    fit = dgpc._dgpc.fit

    def slow(*args, progress=None, **options):
        if progress is not None:
            progress({"iterations": 3, "change": 0.25, "evaluations": 0, "objective": None})
        return fit(*args, progress=progress, **options)

    monkeypatch.setattr(dgpc._dgpc, "fit", slow)
    for verbose in (False, True):
        dgpc.GaussianProcessClassifier(optimizer=None, verbose=verbose).fit(*data)
        printed = capfd.readouterr()
        assert printed.out == "" and printed.err == verbose * (
            "GaussianProcessClassifier: iterations 3, change 0.25, evaluations 0\n"
        )


def test_several_classes_are_combined_by_one_versus_rest() -> None:
    x, y = make_blobs(90, centers=4, random_state=1)
    model = OneVsRestClassifier(Classifier()).fit(x, y)
    assert model.score(x, y) > 0.9 and model.predict_proba(x).shape == (90, 4)


def test_single_hyperparameters_are_fixed_or_bounded(data) -> None:
    kernel = 2.0 * RBF(0.1, "fixed") + 1.0 * Matern([1.0, 1.0], [(0.9, 1.1), (1e-5, 1e5)], nu=2.5)
    model = Classifier(kernel).fit(*data)
    assert model.kernel_.k1.k2.length_scale == pytest.approx(0.1)
    assert 0.9 <= model.kernel_.k2.k2.length_scale[0] <= 1.1
    assert model.kernel_.k2.k2.length_scale[1] != pytest.approx(1.0, abs=1e-6)


def test_a_product_of_constants_has_the_product_of_their_bounds(data) -> None:
    x, y = data
    fixed = ConstantKernel(100.0, "fixed") * ConstantKernel(1.0, (0.1, 10.0)) * RBF(1.0, "fixed")
    assert 10.0 <= np.exp(Classifier(fixed).fit(x, y).kernel_.theta)[0] <= 1000.0
    free = ConstantKernel(3.0, (1.0, 5.0)) * ConstantKernel(2.0, (1.0, 5.0)) * RBF(1.0)
    kernel = Classifier(free, optimizer=None).fit(x, y).kernel_
    np.testing.assert_allclose(np.exp(kernel.bounds[0]), [1.0, 25.0])
    np.testing.assert_allclose(np.exp(kernel.theta[0]), 6.0)


def test_a_second_fit_uses_nothing_of_the_first(data) -> None:
    x, y = data

    def optimizer(objective, initial_theta, bounds):
        return initial_theta, objective(initial_theta)[0]

    model = Classifier(optimizer=optimizer, inducing_points=5).fit(x, y)
    wider = np.column_stack([x, x[:, 0]])
    first = model.fit(wider, y).log_marginal_likelihood_value_
    again = clone(model).fit(wider, y)
    assert first == again.log_marginal_likelihood_value_


def test_partial_fit_refuses_other_classes_than_before(data) -> None:
    x, y = data
    model = Classifier(RBF()).partial_fit(x, y, classes=np.unique(y))
    with pytest.raises(ValueError, match="classes differ"):
        model.partial_fit(x, y, classes=["no", "perhaps"])


@pytest.mark.parametrize("model", [Classifier(inducing_points=8), Classifier(RBF(0.3), random_state=8)])
@pytest.mark.parametrize("is_fitted", [False, True])
def test_every_changed_byte_of_the_state_of_a_pickle_is_refused(model, is_fitted, data) -> None:
    x, y = data
    model = clone(model).fit(x[:20], y[:20]) if is_fitted else model
    state = model.__getstate__()
    content = state["_state"]
    for place in range(len(content)):
        damaged = content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]
        with pytest.raises(ValueError, match="damaged"):
            Classifier().__setstate__({**state, "_state": damaged})


@pytest.mark.parametrize("labels", [["no", "yes"], [0, 1], [False, True], np.array(["a", "b"], object)])
def test_a_pickle_keeps_the_types_of_labels_and_parameters(labels, data) -> None:
    x, y = data
    model = Classifier(RBF(0.3), optimizer=lambda objective, start, bounds: (start, 0.0), random_state=3)
    model.fit(x, np.asarray(labels)[(y == "yes").astype(int)])
    with pytest.raises((pickle.PicklingError, AttributeError), match="lambda"):
        pickle.dumps(model)
    for again in [copy.deepcopy(model), pickle.loads(pickle.dumps(model.set_params(optimizer=None)))]:
        assert again.classes_.dtype == model.classes_.dtype and (again.classes_ == model.classes_).all()
        assert {**again.get_params(), "optimizer": 0} == {**model.get_params(), "optimizer": 0}
        np.testing.assert_array_equal(again.predict(x), model.predict(x))


def test_an_estimator_whose_fit_failed_can_be_copied(data) -> None:
    x, _ = data
    model = Classifier()
    with pytest.raises(ValueError, match="two classes"):
        model.fit(x, np.zeros(len(x)))
    assert pickle.loads(pickle.dumps(model)).get_params() == copy.deepcopy(model).get_params()


@pytest.mark.parametrize("name", ["max_iter_predict", "n_restarts_optimizer"])
@pytest.mark.parametrize("optimizer", ["fmin_l_bfgs_b", None])
def test_bad_numbers_of_iterations_and_restarts_are_refused(name, optimizer, data) -> None:
    for bad in [-1, "a", 1.5, None] + [0] * (name == "max_iter_predict"):
        with pytest.raises((ValueError, TypeError), match=name):
            Classifier(optimizer=optimizer, **{name: bad}).fit(*data)
    assert Classifier(RBF(), optimizer=None, max_iter_predict=np.int64(2)).fit(*data).n_iter_ == 2


def test_a_failed_fit_keeps_the_earlier_one(data) -> None:
    x, y = data
    wider = np.column_stack([x, x[:, 0]])

    def optimizer(objective, initial_theta, bounds):
        raise KeyboardInterrupt

    for model in (Classifier(), Classifier(inducing_points=10)):
        expected = model.fit(x, y).predict_proba(x)
        with pytest.raises(ValueError, match="two classes"):
            model.fit(wider, np.zeros(len(x)))
        with pytest.raises(KeyboardInterrupt):
            model.set_params(optimizer=optimizer).fit(wider, y)
        np.testing.assert_array_equal(model.predict_proba(x), expected)
        with pytest.raises(ValueError, match="expecting 2 features"):
            model.predict_proba(wider)
        assert model.set_params(optimizer=None).fit(wider, y).predict_proba(wider).shape == (80, 2)
