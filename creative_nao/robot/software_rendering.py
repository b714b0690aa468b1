"""Draw a state without OpenGL, by MuJoCo's own ray casting on the processor: the last resort.

Every pixel sends one ray (`mj_multiRay`); where it meets a shape, the formula of fixed-function OpenGL (emission,
ambient, diffuse, specular) gives the colour. No shadows; textures in their mean colour; every shape is opaque.
"""

# The bindings of MuJoCo have no static types.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

_VISIBLE_GROUPS = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
_SHININESS = 128.0  # OpenGL's exponent at a shininess of 1


class SoftwareCanvas:
    """Draws states of one model, in frames of `width` x `height` pixels."""

    def __init__(self, model: Any, width: int, height: int) -> None:
        self._model, self._shape = model, (height, width)
        self._far = float(model.vis.map.zfar * model.stat.extent)
        self._distance = np.full(height * width, self._far)
        skies = np.flatnonzero(model.tex_type == int(mujoco.mjtTexture.mjTEXTURE_SKYBOX))
        self._sky = np.full((1, 3), 0.12)  # behind everything in a model without a sky
        if len(skies):  # six faces, one below the other; the first is a side, from the top of the sky to the bottom
            self._sky = _texture(model, skies[0])[: model.tex_width[skies[0]]].mean(axis=1)
        self._colour = model.geom_rgba[:, :3].astype(np.float64)
        self._finish = np.tile([0.0, 0.5, 0.5], (model.ngeom, 1))  # emission, specular, shininess: MuJoCo's defaults
        for geom in np.flatnonzero(model.geom_matid >= 0):
            material = model.geom_matid[geom]
            texture = int(model.mat_texid[material, int(mujoco.mjtTextureRole.mjTEXROLE_RGB)])
            mean = _texture(model, texture).mean(axis=(0, 1)) if texture >= 0 else 1.0
            self._colour[geom] = model.mat_rgba[material, :3] * mean
            self._finish[geom] = [getattr(model, f"mat_{k}")[material] for k in ("emission", "specular", "shininess")]

    def draw(self, data: Any, camera: int) -> np.ndarray:
        """Draw what a fixed camera sees, as uint8 of shape (height, width, 3); kinematics must be up to date."""
        height, width = self._shape
        eye, axes = data.cam_xpos[camera].copy(), data.cam_xmat[camera].reshape(3, 3)
        tall = np.tan(np.deg2rad(self._model.cam_fovy[camera]) / 2)
        x = ((np.arange(width) + 0.5) / width * 2 - 1) * tall * width / height
        y = (1 - (np.arange(height) + 0.5) / height * 2) * tall
        # All rays end on the plane one metre before the camera, so that distances along them are depths.
        rays = np.stack([*np.meshgrid(x, y), np.full(self._shape, -1.0)], axis=-1).reshape(-1, 3) @ axes.T
        n = len(rays)
        geom, distance, normal = np.empty(n, dtype=np.int32), np.empty(n), np.empty(3 * n)
        mujoco.mj_multiRay(
            self._model, data, eye, rays.ravel(), _VISIBLE_GROUPS, True, -1, geom, distance, normal, n, np.inf
        )
        met = np.flatnonzero((geom >= 0) & (distance < self._far))
        self._distance = np.full(n, self._far)
        self._distance[met] = distance[met]
        upward = rays[:, 2] / np.abs(rays).max(axis=1)
        picture = self._sky[((1 - upward) / 2 * (len(self._sky) - 1)).astype(int)]
        points = eye + distance[met, None] * rays[met]
        picture[met] = self._shade(data, eye, -axes[:, 2], geom[met], points, normal.reshape(-1, 3)[met])
        return (np.clip(picture, 0, 1) * 255).round().astype(np.uint8).reshape(height, width, 3)

    def depth(self) -> np.ndarray:
        """Return the distance of what was drawn last from the camera's plane [m], (height, width)."""
        return self._distance.reshape(self._shape)

    def _shade(
        self, data: Any, eye: np.ndarray, forward: np.ndarray, geom: np.ndarray, points: np.ndarray, normal: np.ndarray
    ) -> np.ndarray:
        """Return the colours of points on shapes, (n, 3)."""
        model, emission, specular, shininess = self._model, *self._finish[geom].T[:, :, None]
        to_eye, head = _unit(eye - points), model.vis.headlight
        lights = [(head.ambient, head.diffuse, head.specular, -forward)] if head.active else []
        for k in np.flatnonzero(model.light_active):
            directional = model.light_type[k] == int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
            to_light = -data.light_xdir[k] if directional else data.light_xpos[k] - points
            lights.append((model.light_ambient[k], model.light_diffuse[k], model.light_specular[k], to_light))
        matt, shine = emission + np.zeros(3), np.zeros((1, 3))
        for ambient, diffuse, glare, to_light in lights:
            way = _unit(np.broadcast_to(to_light, points.shape))
            facing = np.maximum(np.einsum("ni,ni->n", normal, way), 0.0)[:, None]
            glance = np.maximum(np.einsum("ni,ni->n", normal, _unit(way + to_eye)), 0.0)[:, None]
            matt = matt + ambient + facing * diffuse
            shine = shine + (facing > 0) * glance ** (shininess * _SHININESS) * glare
        return self._colour[geom] * matt + specular * shine


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def _texture(model: Any, number: int) -> np.ndarray:
    """Return a texture of the model as numbers from 0 to 1, (height, width, channels)."""
    height, width, channels = (int(getattr(model, f"tex_{name}")[number]) for name in ("height", "width", "nchannel"))
    start = int(model.tex_adr[number])
    return model.tex_data[start : start + height * width * channels].reshape(height, width, channels) / 255
