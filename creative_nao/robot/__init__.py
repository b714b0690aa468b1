"""The NAO in MuJoCo, its ring and its bag, how it performs a trajectory and how it is filmed; no network is needed.

- Model files (MJCF): `NAO_XML`, `BAG_XML`, `RING_XML`, `SCENE_XML`
- Robot: `Scene`, `bare_scene`, `Index`, `place`, `ServoSettings`, `Stiffness`, `POSTURES`, `posture`, `arm_angles`
- Performing: `Performer`, `PlaybackSettings`, `Performance`, `Hits`
- Domain randomisation: `RobotVariation`, `Varied`
- Physical failures: `PhysicalLimits`, `failures`, `first_failure`, `PHYSICAL_FAILURES`
- Drawing: `Renderer`, `can_draw`, `pictures`, `moments`, `film_strip`, `write_gif`, `write_mp4`,
  `imagined_frames`

Names load at first use: importing this package alone loads neither MuJoCo nor GL.
"""

import lazy_loader

from creative_nao.robot import opengl

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
opengl.choose_backend()  # before anything of this package imports MuJoCo
