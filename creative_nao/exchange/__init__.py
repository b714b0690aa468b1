"""Movements out of the project and into it: tables, programs for the robot, ROS, Webots. No network, no simulator.

`read` and `write` do all `FORMATS`; `inspect` and `made_safe` say whether a robot may be asked to do it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
