"""The package as a whole: exports, documentation, types and optional parts."""

import doctest
import importlib.metadata
import inspect
import subprocess
import sys

import dgpc
import pytest

HAS_SKLEARN = importlib.util.find_spec("sklearn") is not None

#: Methods whose documentation must have an example, in addition to every export.
HAVE_EXAMPLES = """
    GaussianProcessClassifier.fit GaussianProcessClassifier.partial_fit GaussianProcessClassifier.predict
    GaussianProcessClassifier.predict_proba GaussianProcessClassifier.decision_function
    GaussianProcessClassifier.latent_mean_and_variance GaussianProcessClassifier.log_marginal_likelihood
""".split()

EXPORTS = [name for name in dgpc.__all__ if HAS_SKLEARN or name != "GaussianProcessClassifier"]


def members() -> list[tuple[str, object]]:
    """Returns every export, and every public member of the exported classes of the compiled part."""
    found = [(name, getattr(dgpc, name)) for name in EXPORTS]
    classes = [(name, one) for name, one in found if inspect.isclass(one) and not issubclass(one, Exception)]
    return found + [
        (f"{name}.{member}", getattr(one, member))
        for name, one in classes
        for member in vars(one)
        if not member.startswith("_")
    ]


@pytest.mark.parametrize("name", EXPORTS)
def test_examples_in_the_documentation_are_right(name: str) -> None:
    finder = doctest.DocTestFinder(exclude_empty=True)
    examples = [test for test in finder.find(getattr(dgpc, name), name, module=False, globs={}) if test.examples]
    expected = {one for one in HAVE_EXAMPLES if one.split(".")[0] == name} | ({name} - {"Error"})
    assert {test.name for test in examples} >= expected
    for example in examples:
        assert doctest.DocTestRunner().run(example).failed == 0


def test_everything_public_is_documented() -> None:
    missing = [name for name, member in members() if not inspect.getdoc(member)]
    assert not missing


def test_signatures_show_their_defaults() -> None:
    for name, member in members():
        if callable(member) and not (inspect.isclass(member) and issubclass(member, Exception)):
            try:
                signature = str(inspect.signature(member))
            except ValueError:
                continue
            assert "Ellipsis" not in signature and "..." not in signature, name


def test_the_version_is_that_of_the_wheel() -> None:
    assert dgpc.__version__ == importlib.metadata.version("dgpc")


def test_the_estimator_without_scikit_learn_names_the_extra() -> None:
    program = (
        "import sys; sys.modules['sklearn'] = None; import dgpc; dgpc.fit\n"
        "try: dgpc.GaussianProcessClassifier\n"
        "except ImportError as error: assert 'dgpc[sklearn]' in str(error)\n"
        "else: raise SystemExit('no error')\n"
        "try: dgpc.nothing\n"
        "except AttributeError: pass\n"
        "else: raise SystemExit('no error')"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_importing_the_package_does_not_import_optional_packages() -> None:
    program = "import sys, dgpc; raise SystemExit(not {'sklearn', 'scipy', 'ray'}.isdisjoint(sys.modules))"
    subprocess.run([sys.executable, "-c", program], check=True)


def test_submodules_are_attributes_of_the_package() -> None:
    program = (
        "import sys, dgpc; dgpc.sharded.fit; sys.modules['ray'] = None\n"
        "try: dgpc.ray\n"
        "except ImportError as error: assert 'dgpc[ray]' in str(error)\n"
        "else: raise SystemExit('no error')"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
    if importlib.util.find_spec("ray"):
        subprocess.run([sys.executable, "-c", "import dgpc; dgpc.ray.Workers"], check=True)


def test_the_type_stubs_describe_the_compiled_part() -> None:
    pytest.importorskip("mypy", reason="mypy is not installed: type stubs are not compared")
    command = [sys.executable, "-m", "mypy.stubtest", "dgpc._dgpc", "--ignore-missing-stub"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout
