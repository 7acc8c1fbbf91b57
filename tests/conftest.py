"""Shared settings: float64, and every shape in a signature checked while the tests run."""

import atexit
import gc
import os
import shutil
import tempfile
from contextlib import contextmanager
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

os.environ.setdefault("JAX_ENABLE_X64", "1")
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # two workers on two cores
# a program compiled in one piece costs all cores together less; XLA ends a process that names a flag it does not know
known_jaxlib = version("jaxlib").startswith("0.10.")
if known_jaxlib and "codegen_split_count" not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_parallel_codegen_split_count=1".strip()
# workers and commands under test share what one has compiled; jaxlib 0.12 once crashed while it wrote to the cache
if known_jaxlib and "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    os.environ["JAX_COMPILATION_CACHE_DIR"] = compiled = tempfile.mkdtemp(prefix="wallid-tests-")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.3")
    atexit.register(shutil.rmtree, compiled, ignore_errors=True)

gc.set_threshold(20_000, 20, 20)  # what is compiled stays: searching it for cycles was a twentieth of the tests' time

from jaxtyping import install_import_hook  # noqa: E402

SOURCE = Path(find_spec("wallid").origin).parent
# without a shape the static check of types is enough: at every call the readers' tests took a third longer
SHAPED = [path for path in sorted(SOURCE.rglob("*.py")) if "jaxtyping" in path.read_text("utf-8")]
install_import_hook(
    [".".join(("wallid", *path.relative_to(SOURCE).with_suffix("").parts)) for path in SHAPED], "typechecker.check"
)

from wallid._internal.xla_options import prepare_xla  # noqa: E402

prepare_xla()  # as the commands do: most of the tests' time is compilation

import hypothesis  # noqa: E402
import jax  # noqa: E402
import pytest  # noqa: E402

hypothesis.settings.register_profile("wallid", deadline=None, derandomize=True, print_blob=True)
hypothesis.settings.load_profile("wallid")

# the files with the longest tests, the slow ones included
FIRST = {"test_demo", "test_diagnosis", "test_notebooks", "test_commands", "test_plates", "test_heat_flux"}

DATA = Path(os.environ.get("WALLID_DATA", Path(__file__).parents[2] / "shared" / "data"))


def pytest_collection_modifyitems(items):
    """Long files first, so that no worker begins one when the other has nothing left."""
    items.sort(key=lambda item: item.path.stem not in FIRST)


@pytest.fixture(scope="module", autouse=True)
def compile_by_need(request):
    """Most files wait for the compiler: XLA optimises only for those marked `runs_long`, and for what they start."""
    hasty = request.node.get_closest_marker("runs_long") is None
    jax.config.update("jax_disable_most_optimizations", hasty)
    os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = str(hasty).lower()


@contextmanager
def no_errors_between_rows():
    """No errors of the faces' cubics: for a truth whose covariance has the stated noise only."""
    from wallid.records import uniform_record
    from wallid.records.face_variation import FaceErrors

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(uniform_record, "cubic_errors", lambda faces, step, noise_std, memory: FaceErrors.none())
        yield


@pytest.fixture
def faces_known_between_rows():
    """`no_errors_between_rows` in one test."""
    with no_errors_between_rows():
        yield


@pytest.fixture(scope="module")
def faces_known_in_all_tests():
    """`no_errors_between_rows` in all tests of a file, and in what they share."""
    with no_errors_between_rows():
        yield


@pytest.fixture(scope="module")
def without_next_measurement():
    """A diagnosis ends with what the record says, in a file that has no test of what to measure next."""
    from wallid.discrepancy import search_for_effects

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search_for_effects, "what_to_measure", lambda *_: ())
        yield


@pytest.fixture
def measured():
    """The folder of measured records; a test that needs it is skipped where it is absent."""
    if not DATA.is_dir():
        pytest.skip(f"no measured records at {DATA}; set WALLID_DATA to their folder")
    return DATA
