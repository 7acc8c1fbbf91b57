"""A section's full-order model beside finite elements, its reduced model over the priors of the materials beside pyMOR.

`python -m benchmarks.accuracy.sections elements`: 30 days at three points of random coursed rubble, by four meshes of
which each has cells of half the size, against quadratic elements.
`python -m benchmarks.accuracy.sections materials`: reduced models of order 60 and 80, made once, at values of materials
and under faces that they have not seen, against the full-order model: at some values inside the range and at all its
corners, two prior standard deviations away. Beside it pyMOR's balanced truncation of order 20, made anew at each value.
"""

import argparse
import itertools
import time

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks.reference.model_reduction import response_of_rows, section_by_pymor
from benchmarks.reference.stone_section import POINTS, hourly_faces, in_elements, stone_section
from wallid.models.section import (
    MaterialRange,
    TensorMesh,
    full_order_section,
    material_sensitivity,
    reduce_section,
    section_response,
)
from wallid.models.section.tensor_mesh import graded_lines

HOUR = 3600.0  # s
DAYS, COARSE, MESHES = 30, 0.015, 4  # days; m, of the first mesh's cells: one across a joint
ELEMENT, SPLIT = 0.005, 8  # m; steps of the finite elements in an hour
FINE = 0.0022  # m, of the mesh beside a joint: 9,951 cells
ORDERS, TRUNCATED = (60, 80), 20  # of reduced models, and of balanced truncation
UNSEEN_DAYS, DIFFERENCE = 8, 1e-3  # days; of ln k or ln c either way
SEED = 2907


def elements(console: Console) -> None:
    """The largest errors of the temperatures at the points, mesh by mesh."""
    faces = hourly_faces(DAYS, SEED)
    places = np.array([(point.x, point.y) for point in POINTS])
    references = []
    for size, split in track(
        ((2.0 * ELEMENT, SPLIT // 2), (ELEMENT, SPLIT)), "finite elements", console=console, transient=True
    ):
        at = np.arange(split * (len(faces) - 1) + 1) / split
        finer = np.stack([np.interp(at, np.arange(len(faces)), face) for face in faces.T], axis=1)
        references.append(in_elements(size).temperatures(finer, HOUR / split, places, split))
    apart = np.abs(references[0] - references[1]).max()
    console.print(f"{DAYS} days; finite elements of twice the size and step differ by {apart:.1e} K")
    section, last = stone_section(), None
    (x, x_part), (y, y_part) = (graded_lines(lines, COARSE) for lines in (section.x_lines, section.y_lines))
    mesh = TensorMesh(x, y, section.cells[np.ix_(y_part, x_part)])
    for _ in track(range(MESHES), "full-order models", console=console, transient=True):
        full = full_order_section(section, POINTS, mesh=mesh)
        found = section_response(full.model, full.conductivity, full.heat_capacity, faces, HOUR)
        error = np.abs(found - references[-1]).max(axis=0)
        order = "" if last is None else f"; order {', '.join(f'{one:.2f}' for one in np.log2(last / error))}"
        console.print(f"{mesh.cells.size} cells: {', '.join(f'{one:.5f}' for one in error)} K{order}")
        mesh, last = mesh.refined(), error


def materials(console: Console, inside: int) -> None:
    """The largest errors of both reductions at each value of the materials."""
    section = stone_section(FINE)
    full, span = full_order_section(section, POINTS), MaterialRange.of(section)
    models = []
    for order in ORDERS:
        began = time.perf_counter()
        models.append(reduce_section(full.model, span, order=order).model)
        seconds = time.perf_counter() - began
        console.print(f"order {order}, {full.mesh.cells.size} cells, made once in {seconds:.1f} s")
    faces = hourly_faces(UNSEEN_DAYS, SEED + 1)
    corners = np.array(list(itertools.product((-2.0, 2.0), repeat=2 * len(span.log_std))))
    points = np.vstack([span.points(inside, SEED), corners])
    rows = []
    for point in track(points, "values of the materials", console=console, transient=True):
        k, c = span.at(point)
        exact, theta = section_response(full.model, k, c, faces, HOUR), _sensitivities(full.model, k, c, faces)
        rows.append([])
        for model in models:
            own, own_theta = material_sensitivity(model, k, c, faces, HOUR)
            size, error = np.sqrt(np.mean(theta**2, axis=0)), own_theta - theta
            rows[-1] += [
                np.abs(own - exact).max() / np.ptp(faces),
                (np.abs(error).max(axis=0) / size).max(),
                (np.sqrt(np.mean(error**2, axis=0)) / size).max(),
            ]
        began = time.perf_counter()
        truncated = section_by_pymor(full.model, k, c, TRUNCATED)
        seconds = time.perf_counter() - began
        other = response_of_rows(truncated, faces, HOUR)
        rows[-1] += [np.abs(other - exact).max() / np.ptp(faces), seconds]
        console.print(f"{point.round(1).tolist()}: {', '.join(f'{one:.1e}' for one in rows[-1])}")
    for name, part in (("inside", np.array(rows[:inside])), ("corners", np.array(rows[inside:]))):
        console.print(f"{name}, {len(part)} values:")
        largest = part.max(axis=0)
        for order, (u, theta, mean) in zip(ORDERS, largest[:-2].reshape(-1, 3), strict=True):
            console.print(
                f"order {order}: u {u:.1e} of the faces' range; theta, over its root mean square: {theta:.1e} at the "
                f"worst row, {mean:.1e} in root mean square"
            )
        seconds = np.median(part[:, -1])
        console.print(f"balanced truncation of order {TRUNCATED}: u {largest[-2]:.1e}, {seconds:.2f} s a value")


def _sensitivities(model, k: np.ndarray, c: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The derivatives by ln k, then by ln c, of each material, by differences, K, `(time, param, output)`."""
    columns = []
    for step in np.eye(2 * len(k)):
        up, down = (np.exp(sign * DIFFERENCE * step).reshape(2, -1) for sign in (1, -1))
        high, low = (section_response(model, k * one[0], c * one[1], faces, HOUR) for one in (up, down))
        columns.append((high - low) / (2.0 * DIFFERENCE))
    return np.stack(columns, axis=1)


def main() -> None:
    """Measure one part, or both."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help="elements or materials (default: both)")
    parser.add_argument("--inside", type=int, default=4, help="number of values of the materials inside their range")
    arguments = parser.parse_args()
    parts = arguments.parts or ["elements", "materials"]
    if unknown := set(parts) - {"elements", "materials"}:
        parser.error(f"no part {unknown.pop()!r}; there are elements and materials")
    import jax

    jax.config.update("jax_enable_x64", True)
    console = Console()
    if "elements" in parts:
        elements(console)
    if "materials" in parts:
        materials(console, arguments.inside)


if __name__ == "__main__":
    main()
