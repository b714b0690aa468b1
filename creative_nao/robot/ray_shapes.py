"""Where rays meet MuJoCo's primitive shapes: exact surfaces, so that a drawing needs no mesh and no OpenGL.

Rays start at one point `origin`, shape (3,), and go along `rays`, shape (n, 3), all in the shape's own frame; `size` is
that of `mjvGeom`: half lengths along x, y, z, without the round ends of a capsule. Each function returns, for each ray,
how many times its direction it takes to the first point on the surface, shape (n,), infinite where the ray passes by.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_PARALLEL = 1e-12


def ellipsoid(origin: np.ndarray, rays: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Meet an ellipsoid, or a sphere, by shrinking space until it is the unit ball."""
    return _ball(origin / size, rays / size, 1.0)


def cylinder(origin: np.ndarray, rays: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Meet a cylinder along z, its wall or one of its two flat ends."""
    nearest = _wall(origin, rays, size)
    for end in (size[2], -size[2]):
        times = _level(origin, rays, end)
        x, y = (origin[axis] + _finite(times) * rays[:, axis] for axis in (0, 1))
        on_it = x * x + y * y <= size[0] ** 2
        nearest = np.where(on_it & (times > 0) & (times < nearest), times, nearest)
    return nearest


def capsule(origin: np.ndarray, rays: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Meet a capsule along z: a wall and two balls, of which the outermost point is the surface."""
    nearest = _wall(origin, rays, size)
    for end in (size[2], -size[2]):
        nearest = np.minimum(nearest, _ball(origin - (0.0, 0.0, end), rays, size[0]))
    return nearest


def box(origin: np.ndarray, rays: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Meet a box: inside all three pairs of faces at once (slab method)."""
    slopes = np.where(np.abs(rays) < _PARALLEL, _PARALLEL, rays)
    one, two = (-size - origin) / slopes, (size - origin) / slopes
    enter, leave = np.minimum(one, two).max(axis=1), np.maximum(one, two).min(axis=1)
    return np.where((enter <= leave) & (enter > 0), enter, np.inf)


def plane(origin: np.ndarray, rays: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Meet the plane z = 0 from above; a size of zero along x or y means without end."""
    times = _level(origin, rays, 0.0)
    on_it = (times > 0) & (origin[2] > 0)
    for axis in (0, 1):
        if size[axis] > 0:
            on_it &= np.abs(origin[axis] + _finite(times) * rays[:, axis]) <= size[axis]
    return np.where(on_it, times, np.inf)


def normals(kind: str, points: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return the outward normals at points on the surface, in the shape's own frame, (n, 3), of length 1."""
    if kind == "plane":
        found = np.broadcast_to(np.array([0.0, 0.0, 1.0]), points.shape)
    elif kind == "box":
        share = points / size
        face = np.abs(share).argmax(axis=1)
        found = np.zeros_like(points)
        rows = np.arange(len(points))
        found[rows, face] = np.sign(share[rows, face])
    elif kind == "ellipsoid":
        found = points / size**2
    elif kind == "capsule":
        found = points.copy()
        found[:, 2] -= np.clip(points[:, 2], -size[2], size[2])
    else:  # a cylinder: at its ends or on its wall, whichever the point is nearer to
        to_end = size[2] - np.abs(points[:, 2])
        to_wall = size[0] - np.hypot(points[:, 0], points[:, 1])
        at_end = (to_end < to_wall)[:, None]
        ends = np.zeros_like(points)
        ends[:, 2] = np.sign(points[:, 2])
        found = np.where(at_end, ends, points * (1.0, 1.0, 0.0))
    return found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), _PARALLEL)


SHAPES: dict[str, Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]] = {
    "plane": plane,
    "box": box,
    "ellipsoid": ellipsoid,
    "capsule": capsule,
    "cylinder": cylinder,
}
"""How rays meet each kind of shape."""


def _ball(origin: np.ndarray, rays: np.ndarray, radius: float) -> np.ndarray:
    a = np.einsum("ni,ni->n", rays, rays)
    b = rays @ origin
    return _first_root(a, b, float(origin @ origin) - radius**2)


def _wall(origin: np.ndarray, rays: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Meet the open tube around z, cut off at both ends."""
    flat = rays[:, :2]
    a = np.einsum("ni,ni->n", flat, flat)
    b = flat @ origin[:2]
    times = _first_root(np.maximum(a, _PARALLEL), b, float(origin[:2] @ origin[:2]) - size[0] ** 2)
    within = np.abs(origin[2] + _finite(times) * rays[:, 2]) <= size[2]
    return np.where(within, times, np.inf)


def _first_root(a: np.ndarray, b: np.ndarray, c: float) -> np.ndarray:
    """Return the smaller solution of a t^2 + 2 b t + c = 0 where it is positive, else infinity."""
    inside = b * b - a * c
    times = (-b - np.sqrt(np.maximum(inside, 0.0))) / a
    return np.where((inside > 0) & (times > 0), times, np.inf)


def _level(origin: np.ndarray, rays: np.ndarray, height: float) -> np.ndarray:
    slope = np.where(np.abs(rays[:, 2]) < _PARALLEL, _PARALLEL, rays[:, 2])
    return (height - origin[2]) / slope


def _finite(times: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(times), times, 0.0)
