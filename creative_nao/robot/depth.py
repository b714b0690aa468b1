"""How far away everything is: depth images beside the renderer's colours."""

# MuJoCo and PyMJCF tell type checkers nothing about their members.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false, reportMissingImports=false
from __future__ import annotations

import mujoco
import numpy as np

from creative_nao.robot.rendering import Renderer


class DepthRenderer(Renderer):
    """A `Renderer` that also tells distances; its arguments and errors are the renderer's."""

    def depth(self, qpos: np.ndarray, camera: str = "close") -> np.ndarray:
        """Measure one state.

        Args:
            qpos: Positions of everything, shape (nq,).
            camera: One of `arena.CAMERAS`.

        Returns:
            Distance from the camera's plane to what each pixel shows [m], float32 of shape (height, width).
        """
        self.frame(qpos, camera)
        raw = np.empty((self._rect.height, self._rect.width), np.float32)
        self._gl.make_current()
        mujoco.mjr_readPixels(None, raw, self._rect, self._context)
        extent = self._model.stat.extent
        near, far = self._model.vis.map.znear * extent, self._model.vis.map.zfar * extent
        buffer = raw[:: -self._smooth, :: self._smooth].astype(np.float64)
        # The classic renderer keeps depth reversed, 1 at the near plane and 0 at the far one.
        return (near * far / (near + buffer * (far - near))).astype(np.float32)
