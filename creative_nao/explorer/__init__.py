"""The memory explorer: a page on which a person touches a memory and the robot performs what is there.

docs/architecture.md follows a click through its files. Only what stands on the page needs the extra `explore`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submod_attrs={"registry": ["cached_map"], "static_export": ["write_page"]}
)
