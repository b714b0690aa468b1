"""Rendering of performed movements: frames, films, depth and a window. MuJoCo is loaded at the first picture."""

# The bindings of MuJoCo have no static types.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import functools
import importlib
import time
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from creative_nao.envs.executors import FRAME_DT_S, Execution, SharedScene
from creative_nao.errors import MissingDependencyError, NotFoundError, SettingsError, nearest_name
from creative_nao.robot import opengl
from creative_nao.schema import Field, checked

if TYPE_CHECKING:
    from creative_nao.robot.rendering import Renderer

Pixels = Annotated[int, Field(ge=1, le=4096)]
RENDER_MODES = ("human", "rgb_array", "rgb_array_list", "depth_array")


@functools.cache
def _font(size: int) -> Any:
    from PIL import ImageFont

    return ImageFont.load_default(size)


def caption(frame: np.ndarray, text: str) -> np.ndarray:
    """Return a copy of a frame, uint8 (height, width, 3), with a line of text on a dark bar at its lower edge."""
    from PIL import Image, ImageDraw

    height, width = frame.shape[:2]
    bar = max(14, height // 16)
    picture = Image.fromarray(frame)
    drawing = ImageDraw.Draw(picture)
    drawing.rectangle((0, height - bar, width, height), fill=(16, 18, 24))
    drawing.text((bar // 2, height - bar // 2), text, fill=(240, 240, 240), font=_font(bar * 5 // 8), anchor="lm")
    return np.asarray(picture).copy()


class Recorder:
    """Keeps the movements performed since the last `render` of one or many environments, and renders them.

    Args:
        shared: Ring, robot and bag.
        mode: One of `RENDER_MODES` or None.
        overlay: Whether colour frames carry a caption.
        n_envs: How many environments.
        width: Width of a frame in pixels.
        height: Height of a frame in pixels.
        camera_name: A camera of the model.

    Raises:
        SettingsError: If there is no such mode or size.
        NotFoundError: If there is no such camera.
    """

    def __init__(
        self,
        shared: SharedScene,
        mode: str | None,
        overlay: bool = False,
        n_envs: int = 1,
        width: int = 640,
        height: int = 480,
        camera_name: str = "close",
    ) -> None:
        if checked(str | None, mode, "render_mode") is not None and mode not in RENDER_MODES:
            raise SettingsError(f"`render_mode` should be one of {', '.join(RENDER_MODES)} or None, but is {mode!r}")
        self._shared, self.mode, self._overlay = shared, mode, checked(bool, overlay, "overlay")
        self._size = checked(Pixels, width, "width"), checked(Pixels, height, "height")
        self._camera = checked(str, camera_name, "camera_name")
        if camera_name != "close" and camera_name not in (known := [one.name for one in shared.scene.spec.cameras]):
            raise NotFoundError(
                f"no camera `{camera_name}`{nearest_name(camera_name, known)}; the known ones are {', '.join(known)}"
            )
        self._movements: list[list[tuple[Execution, str]]] = [[] for _ in range(n_envs)]
        self._renderer: Renderer | None = None
        self._window: Any = None

    def clear(self, env_id: int = 0) -> None:
        """Remove the recorded movements of an environment."""
        self._movements[env_id] = []

    def record(self, env_id: int, execution: Execution, text: str) -> None:
        """Keep the snapshots of a movement for `render`; `text` is its caption."""
        if execution.frames is None:
            return
        if self.mode in ("rgb_array", "depth_array"):
            self.clear(env_id)  # only the last movement is ever rendered
        self._movements[env_id].append((execution, text))

    def render(self, env_id: int = 0) -> Any:
        """Render what was recorded since the last call; the results are those of the environment's `render`.

        Raises:
            MissingDependencyError: If this machine cannot draw or has no display; the message says what helps.
        """
        movements = self._movements[env_id]
        if self.mode is None or (self.mode == "human" and not movements):
            return None
        scene = self._shared.scene
        films = [(one.frames, text) for one, text in movements if one.frames is not None]
        last, text = films[-1] if films else (scene.guard_qpos()[None], "")
        if self.mode in ("rgb_array", "depth_array"):
            arms = last[:, scene.index.arm_qpos]
            widest = last[int(np.linalg.norm(arms - arms[0], axis=1).argmax())]
            return (
                self._drawing().depth(widest, self._camera) if self.mode == "depth_array" else self._frame(widest, text)
            )
        self.clear(env_id)
        if self.mode == "human":
            for frames, _ in films:
                self._play(frames)
            return None
        return [self._frame(snapshot, text) for frames, text in films or [(last, text)] for snapshot in frames]

    def _drawing(self) -> Renderer:
        if self._renderer is None:
            from creative_nao.robot.rendering import Renderer

            self._renderer = Renderer(self._shared.scene.model, *self._size)
        return self._renderer

    def _frame(self, snapshot: np.ndarray, text: str) -> np.ndarray:
        frame = self._drawing().frame(snapshot, self._camera)
        return caption(frame, text) if self._overlay and text else frame

    def _play(self, frames: np.ndarray) -> None:
        """Play snapshots, (n_frames, nq), in a window at real speed; the window opens with the first."""
        import mujoco

        model = self._shared.scene.model
        if self._window is None:
            self._data, missing = mujoco.MjData(model), opengl.missing_window()
            try:
                if missing:
                    raise OSError(missing)
                viewer = importlib.import_module("mujoco.viewer")
                self._window = viewer.launch_passive(model, self._data, show_left_ui=False, show_right_ui=False)
            except Exception as error:  # whatever the window system says
                raise MissingDependencyError(
                    f'render_mode="human" opens a window, which needs a display ({error}); '
                    'without one use "rgb_array" or "rgb_array_list"'
                ) from error
        for snapshot in frames:
            if not self._window.is_running():
                return
            began = time.monotonic()
            self._data.qpos[:] = snapshot
            mujoco.mj_forward(model, self._data)
            self._window.sync()
            time.sleep(max(0.0, FRAME_DT_S - (time.monotonic() - began)))

    def close(self) -> None:
        """Close the window and free what drawing took; may be called again."""
        for part in (self._renderer, self._window):
            if part is not None:
                part.close()
        self._renderer = self._window = None

    def __getstate__(self) -> dict[str, Any]:
        kept = {name: value for name, value in self.__dict__.items() if name != "_data"}
        return {**kept, "_renderer": None, "_window": None}  # windows and drawing contexts stay in their process
