"""dualwinch: control of rope-towed machines, from one symbolic model to compiled closed loops.

The public names stand in ``__init__.pyi``. Each is imported when first used: ``import dualwinch`` costs nothing.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
