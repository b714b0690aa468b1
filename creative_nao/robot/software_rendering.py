"""Draw a MuJoCo scene in plain NumPy: the last resort on a machine without any OpenGL.

MuJoCo lists what is to be seen, with which camera and under which lights (`mjvScene`, which needs no OpenGL). Here each
shape is met by the rays of the pixels it may cover, a depth buffer keeps the nearest, and what is left is shaded once
with the formula of fixed-function OpenGL: emission, ambient, diffuse, specular. There are no shadows and no mirror
images.
"""

# MuJoCo tells type checkers nothing about its members.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from creative_nao.robot import ray_shapes

_KINDS = {
    int(mujoco.mjtGeom.mjGEOM_PLANE): "plane",
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
}
_BACKDROP = (0.10, 0.12, 0.16)
"""Colour behind everything in a model without a sky."""
_SHININESS = 128.0
_ROLE = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)


@dataclass
class _View:
    """The eye and one ray for each pixel, in the world frame; a ray ends on the near plane."""

    eye: np.ndarray
    right: np.ndarray
    up: np.ndarray
    forward: np.ndarray
    half: tuple[float, float]
    near: float
    rays: np.ndarray

    @classmethod
    def of(cls, scene: Any, width: int, height: int) -> _View:
        """Take the mean of the two cameras that MuJoCo prepares for stereo pictures."""
        one, two = scene.camera
        eye, forward = (np.mean([getattr(c, name) for c in (one, two)], axis=0) for name in ("pos", "forward"))
        forward = forward / np.linalg.norm(forward)
        up = np.array(one.up, dtype=np.float64)
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        tall = (one.frustum_top - one.frustum_bottom) / 2
        half = (tall * width / height, tall)
        x = ((np.arange(width) + 0.5) / width * 2 - 1) * half[0]
        y = (1 - (np.arange(height) + 0.5) / height * 2) * half[1]
        near = float(one.frustum_near)
        rays = near * forward + x[None, :, None] * right + y[:, None, None] * up
        return cls(eye.astype(np.float64), right, up, forward, half, near, rays)

    def window(self, corners: np.ndarray) -> tuple[slice, slice] | None:
        """Return rows and columns of the pixels that a convex body with these corners may cover."""
        height, width = self.rays.shape[:2]
        seen = corners - self.eye
        depth = seen @ self.forward
        behind = depth < self.near
        if behind.all():
            return None
        if behind.any():  # cut every line from a corner in front to one behind at the near plane
            front, back = (np.flatnonzero(side) for side in (~behind, behind))
            share = ((depth[front] - self.near)[:, None] / (depth[front][:, None] - depth[back]))[..., None]
            cut = seen[front][:, None] + share * (seen[back] - seen[front][:, None])
            seen = np.concatenate([seen[front], cut.reshape(-1, 3)])
            depth = seen @ self.forward
        x = (seen @ self.right) / depth * self.near / self.half[0]
        y = (seen @ self.up) / depth * self.near / self.half[1]
        left, stop = int((x.min() + 1) / 2 * width), int((x.max() + 1) / 2 * width) + 2
        top, bottom = int((1 - y.max()) / 2 * height), int((1 - y.min()) / 2 * height) + 2
        rows, columns = slice(max(top, 0), min(bottom, height)), slice(max(left, 0), min(stop, width))
        return (rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None


class SoftwareCanvas:
    """Draws prepared scenes of one model.

    Args:
        model: The compiled `mujoco.MjModel`.
        width: Width of a frame in pixels.
        height: Height of a frame in pixels.
    """

    def __init__(self, model: Any, width: int, height: int) -> None:
        self._model, self._width, self._height = model, width, height
        self._textures = {number: _texture(model, number) for number in range(model.ntex)}
        types = np.asarray(model.tex_type)
        skies = np.flatnonzero(types == int(mujoco.mjtTexture.mjTEXTURE_SKYBOX))
        self._sky = self._textures[int(skies[0])] if len(skies) else None
        self._far = float(model.vis.map.zfar * model.stat.extent)
        self._depth = np.full((height, width), self._far)

    def draw(self, scene: Any) -> np.ndarray:
        """Draw what `mjv_updateScene` has put into a `mujoco.MjvScene`, as uint8 of shape (height, width, 3)."""
        view = _View.of(scene, self._width, self._height)
        picture = self._backdrop(view.rays.reshape(-1, 3))
        geoms = [geom for geom in scene.geoms[: scene.ngeom] if int(geom.type) in _KINDS and geom.rgba[3] > 0]
        solid = [geom for geom in geoms if geom.rgba[3] >= 1]
        depth = np.full(picture.shape[:1], np.inf)
        owner = self._cover(view, solid, depth)
        self._depth = np.minimum(depth * view.near, self._far).reshape(self._height, self._width)
        lights = [scene.lights[number] for number in range(scene.nlight)]
        for number, geom in enumerate(solid):
            pixels = np.flatnonzero(owner == number)
            if len(pixels):
                picture[pixels] = self._shaded(view, geom, pixels, depth[pixels], lights)
        for geom in sorted(
            (g for g in geoms if g.rgba[3] < 1), key=lambda g: -float((g.pos - view.eye) @ view.forward)
        ):
            behind = depth.copy()  # what one can see through hides nothing
            pixels = np.flatnonzero(self._cover(view, [geom], behind) == 0)
            if len(pixels):
                over = self._shaded(view, geom, pixels, behind[pixels], lights)
                picture[pixels] += float(geom.rgba[3]) * (over - picture[pixels])
        return (np.clip(picture, 0, 1) * 255).round().astype(np.uint8).reshape(self._height, self._width, 3)

    def depth(self) -> np.ndarray:
        """Return the distance of what was drawn last from the camera's plane [m], (height, width)."""
        return self._depth

    def _cover(self, view: _View, geoms: list[Any], depth: np.ndarray) -> np.ndarray:
        """Find the nearest of the shapes at each pixel; lower `depth`, return the shape's number or -1."""
        shape = (self._height, self._width)
        owner = np.full(shape, -1)
        depth = depth.reshape(shape)
        for number, geom in enumerate(geoms):
            kind, size, turn, place = _pose(geom)
            window = (slice(0, shape[0]), slice(0, shape[1])) if kind == "plane" else view.window(_corners(geom))
            if window is None:
                continue
            rays = view.rays[window]
            times = ray_shapes.SHAPES[kind]((view.eye - place) @ turn, rays.reshape(-1, 3) @ turn, size)
            times = times.reshape(rays.shape[:2])
            closer = (times < depth[window]) & (times >= 1.0)
            depth[window][closer] = times[closer]
            owner[window][closer] = number
        return owner.ravel()

    def _shaded(self, view: _View, geom: Any, pixels: np.ndarray, times: np.ndarray, lights: list[Any]) -> np.ndarray:
        """Return the colour of one shape at some pixels, (n, 3)."""
        kind, size, turn, place = _pose(geom)
        points = view.eye + times[:, None] * view.rays.reshape(-1, 3)[pixels]
        local = (points - place) @ turn
        normal = ray_shapes.normals(kind, local, size) @ turn.T
        to_eye = view.eye - points
        to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
        paint = np.asarray(geom.rgba[:3], dtype=np.float64) * self._texture_at(geom, local, size)
        light, shine = np.full((1, 3), float(geom.emission)), np.zeros((1, 3))
        for lamp in lights:
            way = np.asarray(lamp.pos, dtype=np.float64) - points
            if int(lamp.type) == int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL):
                way = np.broadcast_to(-np.asarray(lamp.dir, dtype=np.float64), points.shape)
            way = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-12)
            facing = np.maximum(np.einsum("ni,ni->n", normal, way), 0.0)[:, None]
            light = light + np.asarray(lamp.ambient) + facing * np.asarray(lamp.diffuse)
            middle = way + to_eye
            middle = middle / np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-12)
            glance = np.maximum(np.einsum("ni,ni->n", normal, middle), 0.0)[:, None] ** (geom.shininess * _SHININESS)
            shine = shine + (facing > 0) * glance * np.asarray(lamp.specular)
        return paint * light + float(geom.specular) * shine

    def _texture_at(self, geom: Any, local: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Return the texture's colour, (n, 3), seen from above as MuJoCo lays flat textures; 1 where there is none."""
        if geom.matid < 0 or (number := int(self._model.mat_texid[geom.matid, _ROLE])) < 0:
            return np.ones((1, 3))
        image = self._textures[number]
        if int(self._model.tex_type[number]) != int(mujoco.mjtTexture.mjTEXTURE_2D):
            return image.reshape(-1, 3).mean(axis=0, keepdims=True)
        share = (local[:, :2] / np.maximum(size[:2], 1e-9) + 1) / 2 * self._model.mat_texrepeat[geom.matid]
        rows, columns = ((share[:, axis] % 1.0 * image.shape[1 - axis]).astype(int) for axis in (1, 0))
        return image[np.minimum(rows, image.shape[0] - 1), np.minimum(columns, image.shape[1] - 1)]

    def _backdrop(self, rays: np.ndarray) -> np.ndarray:
        """Return the sky behind every pixel, (n, 3): the six faces of a cube around the world."""
        if self._sky is None:
            return np.tile(np.array(_BACKDROP), (len(rays), 1))
        side = self._sky.shape[1]
        axis = np.abs(rays).argmax(axis=1)
        largest = rays[np.arange(len(rays)), axis]
        x, y, z = (rays / np.abs(largest)[:, None]).T
        # Faces stand one below the other: right, left, up, down, front, back.
        face = np.select([axis == 0, axis == 1], [np.where(largest > 0, 0, 1), np.where(largest > 0, 4, 5)], 2) + (
            (axis == 2) & (largest < 0)
        )
        across = np.select([axis == 0, axis == 1], [y, x], x)
        down = np.where(axis == 2, y, -z)
        column = np.clip(((across + 1) / 2 * side).astype(int), 0, side - 1)
        row = np.clip(((down + 1) / 2 * side).astype(int), 0, side - 1)
        return self._sky[face * side + row, column]


def _pose(geom: Any) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    """Return kind, half sizes, rotation matrix and place of a shape."""
    size = np.asarray(geom.size, dtype=np.float64)
    turn = np.asarray(geom.mat, dtype=np.float64).reshape(3, 3)
    return _KINDS[int(geom.type)], size, turn, np.asarray(geom.pos, dtype=np.float64)


def _corners(geom: Any) -> np.ndarray:
    """Return the corners of the box around a shape, in the world frame, (8, 3)."""
    kind, size, turn, place = _pose(geom)
    half = np.array([size[0], size[1], size[2] + size[0]]) if kind == "capsule" else size
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    return place + (signs * half) @ turn.T


def _texture(model: Any, number: int) -> np.ndarray:
    """Return a texture of the model as numbers from 0 to 1, (height, width, 3)."""
    height, width, channels = (int(getattr(model, f"tex_{name}")[number]) for name in ("height", "width", "nchannel"))
    start = int(model.tex_adr[number])
    flat = np.asarray(model.tex_data[start : start + height * width * channels], dtype=np.float64) / 255
    image = flat.reshape(height, width, channels)
    return image[..., :3] if channels >= 3 else np.repeat(image[..., :1], 3, axis=2)
