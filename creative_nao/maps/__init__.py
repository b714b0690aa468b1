"""The map of a memory: which movement lies where in its PB space (the paper's Fig. 4)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
