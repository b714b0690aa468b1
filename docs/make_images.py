"""Draw the pictures of the documentation again: `python docs/make_images.py`. Needs off-screen OpenGL."""

from pathlib import Path

from creative_nao import load_demonstrations, load_memory, pb_map
from creative_nao.robot import Performer, film_strip, pictures

IMAGES = Path(__file__).parent / "images"
MOMENTS = {"right_straight": (0, 6, 8, 10, 14, 18), "left_hook": (0, 5, 8, 11, 13, 17)}
"""Ticks of the first punch that tell it best."""


def main() -> None:
    """Draw film strips of two basic actions in physics and the maps of the shipped memories."""
    demos = load_demonstrations()
    performer = Performer()
    for name, ticks in MOMENTS.items():
        done = performer.perform(demos.trajectory(name), demos.dt_s, keep_frames=True)
        per_tick = round(demos.dt_s / done.frame_dt_s)
        frames = done.frames[[tick * per_tick for tick in ticks]]
        images = pictures(performer.scene, frames, camera="close", width=260, height=300, shadows=True, smooth=2)
        film_strip(images, IMAGES / f"{name}.png")
    for name in ("open/0", "half/0", "closed/0"):
        pb_map(load_memory(name)).plot(IMAGES / f"map_{name.replace('/', '_')}.png")


if __name__ == "__main__":
    main()
