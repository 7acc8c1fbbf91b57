"""Models, signals and independent solutions that several tests share. Nothing here computes with wallid
but `slab`, which builds the model under test."""

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.linalg import expm
from scipy.signal import lsim

import wallid

DAY = 86400.0
LENGTH = 0.5
POINTS = (0.1, 0.15, 0.25, 0.3, 0.45)
LEARNED = (2.03e-7, 5.21e-7, 5.81e-7, 5.21e-7)
T_REF = 20.0


def slab(nodes=75, *, length=LENGTH, points=POINTS, degree=0, layers=()):
    wall = wallid.Wall(length=length, diffusivity_prior=5e-7, layers=layers)
    outputs = [wallid.models.Output(x, name=f"T{i}") for i, x in enumerate(points)]
    return wallid.models.finite_volume_model(wall, outputs, nodes=nodes, profile_degree=degree)


def fourier(alpha, length=LENGTH):
    return DAY * np.asarray(alpha) / length**2


def faces(left, right=0.0):
    return np.stack(np.broadcast_arrays(left, right), axis=1).astype(float)


def half_minutes():
    """The validation case's rows, in days."""
    return np.arange(2881) * 30.0 / DAY


def learned_courses():
    """The paper's two learning signals on the left face, over T_ref."""
    t = half_minutes()
    return 5 * np.sin(2 * np.pi * t) / T_REF, 20 * np.sin(6 * np.pi * t) / T_REF


def unlearned_course():
    """The left face of the paper's estimation section, over T_ref."""
    return 3 * (1 - np.cos(4 * np.pi * half_minutes())) / T_REF


def paper_signals():
    slow, fast = learned_courses()
    inputs = np.stack([faces(course) for course in (slow, slow, slow, fast)])
    return wallid.reduction.TrainingSignals(fourier(LEARNED), half_minutes()[1], inputs, np.zeros((4, 1)))


def scipy_field_and_sensitivity_of_cubics(system, fo, record, row, rows, scale, initial):
    """u and theta over a window whose faces are monotone cubics through the whole record, by SciPy's `expm`.

    Each row is one step of the matrices of field and sensitivity with the powers of s, from 0 at a row to 1 at the
    next, as further states.
    """
    A, B, C, D, P = (np.asarray(part) for part in (system.A, system.B, system.C, system.D, system.P))
    n, zero, powers = len(A), np.zeros_like(A), 4
    h = (record.time[1] - record.time[0]) / DAY
    cubics = PchipInterpolator(np.arange(len(record.faces)), (record.faces - scale.temperature_min) / scale.temperature)
    matrix = np.zeros((2 * n + 2 * powers, 2 * n + 2 * powers))
    matrix[: 2 * n, : 2 * n] = h * np.block([[fo * A, zero], [A, fo * A]])
    matrix[: 2 * n, 2 * n : 2 * n + 2] = h * np.vstack([fo * B, B])
    matrix[2 * n : -2, 2 * n + 2 :] = np.eye(2 * (powers - 1))
    step = expm(matrix)[: 2 * n]
    x, states = np.concatenate([P @ initial, np.zeros(n)]), []
    for k in range(row, row + rows):
        states.append(x)
        third = cubics(k + 0.5, 3) if k + 1 < len(record.faces) else np.zeros(2)
        second = cubics(k + 0.5, 2) - 0.5 * third  # of the interval that begins here
        x = step @ np.concatenate([x, cubics(k), cubics(k, 1), second, third])
    states = np.array(states)
    faces = np.asarray(cubics(np.arange(row, row + rows)))
    return states[:, :n] @ C.T + faces @ D.T, states[:, n:] @ C.T


def scipy_field_and_sensitivity(system, fo, time, inputs, initial):
    """u and theta by `scipy.signal.lsim` on the paper's matrices, theta system explicit."""
    A, B, C, D, P = (np.asarray(part) for part in (system.A, system.B, system.C, system.D, system.P))
    n, zero = len(A), np.zeros_like(A)
    stacked = (
        np.block([[fo * A, zero], [A, fo * A]]),
        np.vstack([fo * B, B]),
        np.block([[C, np.zeros_like(C)], [np.zeros_like(C), C]]),
        np.vstack([D, np.zeros_like(D)]),
    )
    start = np.concatenate([P @ initial, np.zeros(n)])
    _, y, _ = lsim(stacked, inputs, time, X0=start, interp=True)
    return y[:, : len(C)], y[:, len(C) :]
