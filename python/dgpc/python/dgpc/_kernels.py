"""Kernels of scikit-learn as priors, and back.

A kernel becomes a sum of terms. Each term is a constant times one or more correlations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    Kernel,
    Matern,
    Product,
    RationalQuadratic,
    Sum,
)

from . import _dgpc

SUPPORTED = (
    "ConstantKernel, RBF, Matern with nu 0.5, 1.5, 2.5 or inf, RationalQuadratic, and sums and products of these"
)

MATERN_SHAPES = {0.5: "matern12", 1.5: "matern32", 2.5: "matern52", np.inf: "squared-exponential"}


@dataclass(frozen=True)
class Translation:
    """A kernel of scikit-learn in the form of a sum of terms, and its prior.

    Attributes
    ----------
    kernel : Kernel
        The sum of terms. Its hyperparameters are the learned parameters of `prior`.
    prior : Prior
    order : array of int
        For every hyperparameter of `kernel`, free or fixed, its place among the parameters of `prior`.
    is_free : array of bool
        For every hyperparameter of `kernel`, whether it is not fixed.
    """

    kernel: Any
    prior: _dgpc.Prior
    order: NDArray[np.intp]
    is_free: NDArray[np.bool_]

    def prior_at(self, theta: NDArray[np.float64]) -> _dgpc.Prior:
        """Returns the prior for the free hyperparameters `theta`, which are logarithms."""
        values = self.prior.parameter_values
        places = self.order[self.is_free]
        if np.shape(theta) != places.shape:
            raise ValueError(f"expected {places.size} hyperparameters, found an array of shape {np.shape(theta)}")
        values[places] = theta
        return self.prior.with_parameters(values)

    def theta_of(self, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the entries of the free hyperparameters from a list of all parameters."""
        return np.asarray(parameters[self.order[self.is_free]])

    def bounds(self) -> list[Any]:
        """Returns the bounds of every parameter of the prior, as `dgpc.learn` expects them."""
        limits: list[Any] = [None] * self.order.size
        each: list[Any] = []
        for parameter in self.kernel.hyperparameters:
            each += ["fixed"] * parameter.n_elements if parameter.fixed else map(tuple, parameter.bounds.tolist())
        for place, limit in zip(self.order, each):
            limits[place] = limit
        return limits


def translate(kernel: Any, dimension: int) -> Translation:
    """Translates a kernel of scikit-learn for inputs of `dimension` columns.

    Raises
    ------
    ValueError
        If a part of the kernel is not supported, or has length-scales for another number of columns.
    """
    terms = [_term(factors) for factors in _products(kernel)]
    normal = _sum([_product(term) for term in terms])
    translated = [_translated(term, dimension) for term in terms]
    order: list[int] = []
    for term in terms:
        order.extend(_places(term, len(order)))
    free = [[not parameter.fixed] * parameter.n_elements for parameter in normal.hyperparameters]
    is_free = np.array([one for each in free for one in each], dtype=bool)
    return Translation(normal, _dgpc.Prior(_dgpc.Kernel(translated)), np.array(order, dtype=np.intp), is_free)


def _products(kernel: Any) -> list[list[Any]]:
    """Returns the summands of a kernel, each as a list of factors."""
    if isinstance(kernel, Sum):
        return _products(kernel.k1) + _products(kernel.k2)
    if isinstance(kernel, Product):
        return [first + second for first in _products(kernel.k1) for second in _products(kernel.k2)]
    is_supported = type(kernel) in (ConstantKernel, RBF, RationalQuadratic)
    if is_supported or (type(kernel) is Matern and kernel.nu in MATERN_SHAPES):
        return [[kernel]]
    found = kernel if isinstance(kernel, Kernel) else type(kernel).__name__
    raise ValueError(f"the kernel {found} is not supported; supported are {SUPPORTED}")


def _term(factors: list[Any]) -> list[Any]:
    """Returns a product with exactly one constant, which comes first."""
    constants = [factor for factor in factors if type(factor) is ConstantKernel]
    others = [factor for factor in factors if type(factor) is not ConstantKernel]
    if not others:
        raise ValueError(f"a constant alone is not supported; supported are {SUPPORTED}")
    value = float(np.prod([constant.constant_value for constant in constants]))
    is_fixed = [constant.hyperparameters[0].fixed for constant in constants]
    if all(is_fixed):
        return [ConstantKernel(value, "fixed"), *others]
    # The bounds of a product of constants are the products of their bounds. A fixed one is its own bound.
    limits = [
        [constant.constant_value] * 2 if fixed else constant.hyperparameters[0].bounds[0]
        for constant, fixed in zip(constants, is_fixed)
    ]
    lower, upper = np.prod(np.array(limits, dtype=float), axis=0)
    return [ConstantKernel(value, (float(lower), float(upper))), *others]


def _product(factors: list[Any]) -> Any:
    """Returns the product of kernels."""
    product = factors[0]
    for factor in factors[1:]:
        product = Product(product, factor)
    return product


def _sum(kernels: list[Any]) -> Any:
    """Returns the sum of kernels."""
    total = kernels[0]
    for kernel in kernels[1:]:
        total = Sum(total, kernel)
    return total


def _translated(term: list[Any], dimension: int) -> _dgpc.Term:
    """Returns a term for a product of a constant and correlations."""
    constant, *factors = term
    product = _correlation(factors[0], dimension)
    for factor in factors[1:]:
        product = product * _correlation(factor, dimension)
    return product * float(constant.constant_value)


def _correlation(factor: Any, dimension: int) -> _dgpc.Term:
    """Returns a term of variance 1 for one correlation."""
    shape = "squared-exponential"
    if type(factor) is Matern:
        shape = MATERN_SHAPES[factor.nu]
    elif type(factor) is RationalQuadratic:
        shape = f"rational-quadratic:{float(factor.alpha)!r}"
    length_scale = np.asarray(factor.length_scale, dtype=float)
    if length_scale.size == 1 and not getattr(factor, "anisotropic", False):
        return _dgpc.Term(shape, float(length_scale.reshape(())), dimension=dimension)
    if length_scale.shape != (dimension,):
        raise ValueError(f"the kernel has {length_scale.size} length-scales, but the inputs have {dimension} columns")
    return _dgpc.Term(shape, length_scale)


def _places(term: list[Any], first: int) -> list[int]:
    """Returns the places of the hyperparameters of a term, in scikit-learn's order, among the parameters of a prior.

    The orders differ for a rational quadratic: scikit-learn has alpha first.
    """
    places = [first]
    for factor in term[1:]:
        following = first + len(places)
        if type(factor) is RationalQuadratic:
            places += [following + 1, following]
        else:
            places += range(following, following + np.size(factor.length_scale))
    return places
