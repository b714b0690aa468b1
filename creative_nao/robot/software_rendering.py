"""Draw a state without OpenGL, by MuJoCo's own ray casting on the processor: the last resort, without shadows.

Every pixel sends one ray (`mj_multiRay`); where it meets a shape, the formula of fixed-function OpenGL (emission,
ambient, diffuse, specular) gives the colour. Textures are drawn in their mean colour, the sky as a gradient.
"""

# The bindings of MuJoCo have no static types.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

_VISIBLE_GROUPS = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
_BACKGROUND = np.full((1, 3), 0.12)
"""Colour behind everything in a model without a sky."""
_SHININESS = 128.0
"""Exponent of OpenGL at a shininess of 1."""


class SoftwareCanvas:
    """Draws states of one model.

    Args:
        model: The compiled `mujoco.MjModel`.
        width: Width of a frame in pixels.
        height: Height of a frame in pixels.
    """

    def __init__(self, model: Any, width: int, height: int) -> None:
        self._model, self._shape = model, (height, width)
        self._far = float(model.vis.map.zfar * model.stat.extent)
        self._distance = np.full(height * width, self._far)
        textures = [_texture(model, number) for number in range(model.ntex)]
        skies = np.flatnonzero(model.tex_type == int(mujoco.mjtTexture.mjTEXTURE_SKYBOX))
        # The six faces stand one below the other; the first is a side, from the top of the sky to the bottom.
        self._sky = textures[skies[0]][: model.tex_width[skies[0]]].mean(axis=1) if len(skies) else _BACKGROUND
        material = model.geom_matid
        painted = np.flatnonzero(material >= 0)
        self._colour = model.geom_rgba[:, :3].astype(np.float64)
        self._finish = np.tile([0.0, 0.5, 0.5], (model.ngeom, 1))  # MuJoCo's defaults
        for geom in painted:
            texture = int(model.mat_texid[material[geom], int(mujoco.mjtTextureRole.mjTEXROLE_RGB)])
            mean = textures[texture].mean(axis=(0, 1)) if texture >= 0 else 1.0
            self._colour[geom] = model.mat_rgba[material[geom], :3] * mean
            finish = (getattr(model, f"mat_{name}")[material[geom]] for name in ("emission", "specular", "shininess"))
            self._finish[geom] = tuple(finish)

    def draw(self, data: Any, camera: int) -> np.ndarray:
        """Draw what a fixed camera sees, as uint8 of shape (height, width, 3); kinematics must be up to date."""
        height, width = self._shape
        eye, axes = data.cam_xpos[camera].copy(), data.cam_xmat[camera].reshape(3, 3)
        tall = np.tan(np.deg2rad(self._model.cam_fovy[camera]) / 2)
        x = ((np.arange(width) + 0.5) / width * 2 - 1) * tall * width / height
        y = (1 - (np.arange(height) + 0.5) / height * 2) * tall
        # A ray of this length ends one metre before the camera's plane, so that distances are depths.
        rays = np.stack([*np.meshgrid(x, y), np.full(self._shape, -1.0)], axis=-1).reshape(-1, 3) @ axes.T
        geom, distance = np.empty(len(rays), dtype=np.int32), np.empty(len(rays))
        normal = np.empty(rays.size)
        groups, far = _VISIBLE_GROUPS, self._far
        mujoco.mj_multiRay(
            self._model, data, eye, rays.ravel(), groups, True, -1, geom, distance, normal, len(rays), 1e10
        )
        met = np.flatnonzero((geom >= 0) & (distance < far))
        self._distance = np.full(len(rays), far)
        self._distance[met] = distance[met]
        height_in_sky = rays[:, 2] / np.abs(rays).max(axis=1)  # 1 straight up, -1 straight down
        picture = self._sky[((1 - height_in_sky) / 2 * (len(self._sky) - 1)).astype(int)]
        points = eye + distance[met, None] * rays[met]
        picture[met] = self._shaded(data, eye, -axes[:, 2], geom[met], points, normal.reshape(-1, 3)[met])
        return (np.clip(picture, 0, 1) * 255).round().astype(np.uint8).reshape(height, width, 3)

    def depth(self) -> np.ndarray:
        """Return the distance of what was drawn last from the camera's plane [m], (height, width)."""
        return self._distance.reshape(self._shape)

    def _shaded(
        self, data: Any, eye: np.ndarray, forward: np.ndarray, geom: np.ndarray, points: np.ndarray, normal: np.ndarray
    ) -> np.ndarray:
        """Return the colours of points on shapes, (n, 3)."""
        model, emission, specular, shininess = self._model, *self._finish[geom].T[:, :, None]
        to_eye = _unit(eye - points)
        head = model.vis.headlight
        lamps = [(head.ambient, head.diffuse, head.specular, -forward)] if head.active else []
        lamps += [
            (model.light_ambient[k], model.light_diffuse[k], model.light_specular[k],
             -data.light_xdir[k] if model.light_type[k] == int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
             else data.light_xpos[k] - points)
            for k in np.flatnonzero(model.light_active)
        ]  # fmt: skip
        light, shine = emission + np.zeros((1, 3)), np.zeros((1, 3))
        for ambient, diffuse, mirrored, way in lamps:
            way = _unit(np.broadcast_to(way, points.shape))
            facing = np.maximum(np.einsum("ni,ni->n", normal, way), 0.0)[:, None]
            glance = np.maximum(np.einsum("ni,ni->n", normal, _unit(way + to_eye)), 0.0)[:, None]
            light = light + ambient + facing * diffuse
            shine = shine + (facing > 0) * glance ** (shininess * _SHININESS) * mirrored
        return self._colour[geom] * light + specular * shine


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def _texture(model: Any, number: int) -> np.ndarray:
    """Return a texture of the model as numbers from 0 to 1, (height, width, 3)."""
    height, width, channels = (int(getattr(model, f"tex_{name}")[number]) for name in ("height", "width", "nchannel"))
    start = int(model.tex_adr[number])
    image = model.tex_data[start : start + height * width * channels].reshape(height, width, channels) / 255
    return image[..., :3] if channels >= 3 else np.repeat(image[..., :1], 3, axis=2)
