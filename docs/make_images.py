"""Draw the pictures of the documentation again: `python docs/make_images.py [strips|film|maps|physical|small] ...`.

`docs/make_explorer_images.py` takes those of the explorer.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from creative_nao import load_demonstrations, load_memory, pb_map
from creative_nao.envs.physical_map import PhysicalMap
from creative_nao.maps.figure_style import save_small
from creative_nao.robot import Performer, PlaybackSettings, film_strip, pictures, write_gif

DOCS = Path(__file__).parent
IMAGES = DOCS / "images"
MEMORIES = ("open_0", "half_0", "closed_0")
MOMENTS = {"right_straight": (0, 6, 8, 10, 14, 18), "left_hook": (0, 5, 8, 11, 13, 17)}
"""Ticks of the first punch that tell it best."""
FILM = ("right_straight", "left_hook")
"""Basic actions that stand in the film, each beside a movement that nobody taught."""
FILM_MEMORY, FILM_PB = "half/0", (0.3, -0.1)
"""Where that movement comes from: the PB point of the README's example."""
FILM_TICKS = slice(2, 19)
FILM_FRAME_S = 0.05


def strips() -> None:
    """Draw film strips of two basic actions in physics."""
    demos = load_demonstrations()
    performer = Performer()
    for name, ticks in MOMENTS.items():
        done = performer.perform(demos.trajectory(name), demos.dt_s, keep_frames=True)
        assert done.frames is not None
        per_tick = round(demos.dt_s / done.frame_dt_s)
        frames = done.frames[[tick * per_tick for tick in ticks]]
        images = pictures(performer.scene, frames, camera="close", width=260, height=300, shadows=True, smooth=2)
        film_strip(images, IMAGES / f"{name}.png")


def film() -> None:
    """Draw two taught movements and a new one side by side, at the robot's own pace, as a GIF of less than 1 MB."""
    from PIL import Image, ImageDraw

    memory = load_memory(FILM_MEMORY)
    demos = memory.demonstrations
    movements = {f"taught: {name.replace('_', ' ')}": demos.trajectory(name) for name in FILM}
    movements["nobody taught this"] = memory.generate([FILM_PB])[0]
    performer = Performer(settings=PlaybackSettings(frame_dt_s=FILM_FRAME_S))
    columns = []
    for caption, trajectory in movements.items():
        performance = performer.perform(trajectory, demos.dt_s, keep_frames=True)
        assert performance.frames is not None
        per_tick = round(demos.dt_s / performance.frame_dt_s)
        frames = performance.frames[FILM_TICKS.start * per_tick : FILM_TICKS.stop * per_tick]
        images = pictures(performer.scene, frames, camera="close", width=256, height=240, shadows=True, smooth=2)
        captioned = [Image.fromarray(image) for image in images]
        for image in captioned:
            ImageDraw.Draw(image).text(
                (8, 220), caption, fill="white", stroke_width=2, stroke_fill="black", font_size=14
            )
        columns.append([np.asarray(image) for image in captioned])
    write_gif(
        [np.concatenate(row, axis=1) for row in zip(*columns, strict=True)],
        IMAGES / "boxing.gif",
        frame_dt_s=FILM_FRAME_S,
    )


def maps() -> None:
    """Draw the maps of the shipped memories."""
    for name in MEMORIES:
        pb_map(load_memory(name.replace("_", "/"))).plot(IMAGES / f"map_{name}.png")


def small() -> None:
    """Write the pictures, screenshots too, with few colours: a third of their size, for the source archive."""
    from PIL import Image

    for path in sorted(IMAGES.rglob("*.png")):
        with Image.open(path) as picture:
            done = picture.mode == "P"
        if not done:
            save_small(path, path)


def physical() -> None:
    """Draw what the robot makes of them and sum it up, from the maps in docs/results/physical."""
    for name in MEMORIES:
        result = DOCS / "results" / "physical" / f"{name}.npz"
        chart = PhysicalMap.load(result)
        chart.plot(IMAGES / f"physical_map_{name}.png")
        result.with_suffix(".json").write_text(json.dumps(chart.summary(), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    drawn = {"strips": strips, "film": film, "maps": maps, "physical": physical, "small": small}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*", help="default: all")
    words = parser.parse_args().words or list(drawn)
    if unknown := [word for word in words if word not in drawn]:
        parser.error(f"no pictures `{unknown[0]}`; there are {', '.join(drawn)}")
    for word in words:
        drawn[word]()
