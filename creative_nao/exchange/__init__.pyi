from .formats import (
    FORMATS,
    WRITABLE,
    Exported,
    format_for,
    read,
    read_all,
    read_content,
    recognise,
    write,
)
from .keys import (
    NOTHING_SAID,
    Reading,
    Recording,
)
from .motion import (
    Motion,
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
    "NOTHING_SAID",
    "UNSAFE",
    "WRITABLE",
    "Exported",
    "Finding",
    "Motion",
    "Reading",
    "Recording",
    "Unsafe",
    "UnsafeMotionError",
    "format_for",
    "inspect",
    "made_safe",
    "read",
    "read_all",
    "read_content",
    "recognise",
    "write",
]
