from .formats import (
    FORMATS,
    Exported,
    format_for,
    read,
    recognise,
    write,
)
from .keys import (
    Motion,
    Recording,
)
from .safety import (
    UNSAFE,
    Finding,
    Unsafe,
    UnsafeMotionError,
    inspect,
    made_safe,
)

__all__ = [
    "FORMATS",
    "UNSAFE",
    "Exported",
    "Finding",
    "Motion",
    "Recording",
    "Unsafe",
    "UnsafeMotionError",
    "format_for",
    "inspect",
    "made_safe",
    "read",
    "recognise",
    "write",
]
