from . import measures
from .agents import (
    load_agent,
)
from .demonstrations import (
    Demonstrations,
    load_demonstrations,
)
from .errors import (
    CreativeNaoError,
    FileFormatError,
    MissingDependencyError,
    NotFoundError,
    SettingsError,
    ShapeError,
    TrainingError,
)
from .maps import (
    PBMap,
    pb_map,
)
from .model import (
    Memory,
    load_memory,
    train,
)

__version__: str

__all__ = [
    "CreativeNaoError",
    "Demonstrations",
    "FileFormatError",
    "Memory",
    "MissingDependencyError",
    "NotFoundError",
    "PBMap",
    "SettingsError",
    "ShapeError",
    "TrainingError",
    "load_agent",
    "load_demonstrations",
    "load_memory",
    "measures",
    "pb_map",
    "train",
]
