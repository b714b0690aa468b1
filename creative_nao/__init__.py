"""A robot invents movements of its own, and its creativity is measured.

A NAO humanoid is taught six boxing actions; a recurrent network with parametric biases learns them, and its PB space
becomes the robot's memory: every point is a movement, the taught ones and, between them, new ones.

Data: `load_demonstrations`, `Demonstrations`.
Memory: `train`, `load_memory`, `Memory`, `pb_map`, `PBMap`.
Scores: `measures`.
Environments: `gymnasium.make("CreativeNao/Boxing-v0")`, registered by this import.
Agents: `load_agent`.
Errors: `CreativeNaoError` and its children.

Names are loaded when first used; importing the package loads neither torch nor mujoco.
"""

import sys

if sys.argv[:1] == ["-m"] and "creative_nao" in sys.orig_argv and not sys.flags.safe_path:
    # `python -m creative_nao`: a numpy.py in the current folder is none of ours, so that is searched last.
    sys.path.append(sys.path.pop(0))

import lazy_loader

from creative_nao.envs import register_environments

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = "0.1.0"

register_environments()
